"""MCAP messages that are JSON, as tables of names and values."""

import json
from collections.abc import Callable
from typing import Any

from mcap.decoder import DecoderFactory
from mcap.records import Schema


class JsonFactory(DecoderFactory):
    """Decodes messages whose channel says `json`."""

    def decoder_for(
        self, message_encoding: str, schema: Schema | None
    ) -> Callable[[bytes], Any] | None:
        """Return the decoder of a channel's messages, None if they are not JSON."""
        return json.loads if message_encoding == "json" else None
