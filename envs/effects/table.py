"""The effects reference of the documentation, generated from the classes: a page for each place.

    python -m benchmarks.pages      # writes docs/reference/effects/, among others

`pages()` maps the names of the files to their text.
"""

from collections.abc import Iterable, Sequence

from envs.effects import EFFECTS, Effect

INTRODUCTION = """# Effects

An effect is a named way in which a robot differs from its model. Randomization draws its value, an
evaluation sweeps it, and a diagnosis estimates it. These pages are generated from the classes in
`envs/effects`.

"""
USE = """
## Use

```python
from envs.effects import load_effects, make

effect = make("stribeck_friction", where="elbow", free=("speed",))  # value and speed are drawn
plant = Plant(spec, [effect, make("link_mass", where="forearm", how="scale")], num_rows=256)
plant = Plant(spec, fixed=load_effects("effects.yaml"))             # as a diagnosis found them
```

* **where** is the name of a joint, actuator, body or geom, or for some effects a pattern such as
  `hip_*`. Without it, one value holds for all driven joints or actuators.
* **how** is `add`, `scale` or `set`; the first one listed is the default.
* **Neutral** values (adding 0, scaling by 1, setting the model's value) do not change a single bit
  of a simulation. `backlash` and `joint_compliance` add a joint, which changes it by rounding
  errors.
* **Extras** are constants, or parameters if listed in `free`.
* **Several effects** at one location apply in the order given, fixed ones first.

To add your own effect, see [Extend](../../how-to/extend.md#an-effect).

## Order within a control step

1. The command arrives: `packet_loss`, then a servo's `encoder_offset`. The engine's delay
   line applies `command_delay`.
2. Before each physics step: profiles, feedback through play or springs, `dead_zone`,
   `supply_sag`, `thermal_derating`, friction, `cogging`.
3. After the step, the sensors: `observation_delay`, `encoder_offset`, `sensor_noise`,
   `quantization`, `velocity_filter`.
"""
PLACES = {
    "joint": "Joints",
    "actuator": "Actuators",
    "body": "Bodies",
    "contact": "Contacts",
    "robot": "The whole robot",
}


def pages() -> dict[str, str]:
    """Return the text of each page by its file's name: the index, then one for each place."""
    own = {place: [e for e in EFFECTS.values() if e.place == place] for place in PLACES}
    texts = {"index.md": INTRODUCTION + contents(own) + USE}
    for place, title in PLACES.items():
        head = f"# Effects: {title.lower()}\n\n[All effects](index.md)\n\n"
        texts[f"{place}.md"] = head + "\n".join(_section(effect) for effect in own[place])
    return texts


def contents(effects: dict[str, list[type[Effect]]]) -> str:
    """Return a table of links: the effects of each place."""
    rows = [("place", "effects")]
    for place, title in PLACES.items():
        links = ", ".join(f"[`{e.name}`]({place}.md#{e.name})" for e in effects[place])
        rows.append((title, links))
    return _markdown(rows)


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    lines.insert(1, "|" + "---|" * len(rows[0]))
    return "\n".join(lines) + "\n"


def _section(effect: type[Effect]) -> str:
    """Return what an effect is, its symptom and source, and how to isolate it."""
    unit = f" {_unit(effect)}" if _unit(effect) else ""
    low, high = effect.typical
    hows = ", ".join(f"`{how}`" for how in effect.hows)
    sides = f"; side: {', '.join(effect.sides)}" if effect.sides else ""
    lines = [
        f"## {effect.name}\n",
        f"{_docstring(effect)}\n",
        f"* Symptom: {effect.symptom}.",
        f"* Isolate it: {effect.experiment}.",
        f"* Equation and source: {effect.source}.",
        f"* Typical values: {low:g} to {high:g}{unit}; how: {hows}{sides}.",
        *_extras(effect),
    ]
    return "\n".join(lines) + "\n"


def _extras(effect: type[Effect]) -> Iterable[str]:
    for e in effect.extras:
        default = "no default" if e.default is None else f"default {e.default:g}"
        yield f"* `{e.name}`{f' [{e.unit}]' if e.unit else ''}: {e.about}; {default}."


def _unit(effect: type[Effect]) -> str:
    """Return the effect's unit; "" for a number without one."""
    return "" if effect.unit in ("1", "factor") else effect.unit


def _docstring(effect: type[Effect]) -> str:
    """Return the class's docstring without its Args, a paragraph a line."""
    text = (effect.__doc__ or "").split("Args:")[0].strip()
    paragraphs = [" ".join(part.split()) for part in text.split("\n\n")]
    return "\n\n".join(part for part in paragraphs if part)
