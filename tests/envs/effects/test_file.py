from pathlib import Path

import numpy as np
import pytest
import yaml

from envs.effects import Effect, load_effects, make, write_effects
from envs.errors import EffectError

BOMB = [("1", "a"), *((f"*{a}", b) for a, b in zip("abcdefgh", "bcdefghi", strict=True))]
NESTED = "[" + ", ".join(f"&{b} [{', '.join([a] * 9)}]" for a, b in BOMB) + "]"


def every_kind() -> list[tuple[Effect, tuple[float, ...]]]:
    """Effects with a side, two values, extras, free extras, options and another way."""
    return [
        (make("backlash", where="hinge", side="link"), (0.049,)),
        (make("gravity_tilt"), (0.02, -0.01)),
        (make("stribeck_friction", where="hinge", free=("speed",)), (0.03, 0.7)),
        (make("supply_sag", voltage=5.0, torque_constant=0.35), (0.4,)),
        (make("ground_friction", where="foot", friction_mode="seed"), (0.8,)),
        (make("link_mass", where="link", how="scale"), (1.1,)),
        (make("supply_voltage", drive="current"), (0.9,)),
        (make("motor_strength", where="a", braking="kept"), (0.8,)),
    ]


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Effects come back with their places, sides, ways, extras, options and values."""
    path = tmp_path / "effects.yaml"
    write_effects(path, every_kind(), [(0.045, 0.053)] + [None] * 7)
    for (effect, values), (again, read) in zip(every_kind(), load_effects(path), strict=True):
        assert type(again) is type(effect)
        assert (again.where, again.side, again.how) == (effect.where, effect.side, effect.how)
        assert again.options() == effect.options()
        if effect.free:  # what was fitted is a constant of what was found
            assert again.extra["speed"] == values[1]
            assert read == values[:1]
        else:
            assert (again.extra, read) == (effect.extra, values)


def test_the_file_has_the_standard_keys(tmp_path: Path) -> None:
    """A list of plain mappings that any program can read."""
    path = tmp_path / "effects.yaml"
    write_effects(path, every_kind()[:1], [(0.045, 0.053)])
    assert yaml.safe_load(path.read_text()) == [
        {
            "effect": "backlash",
            "where": "hinge",
            "side": "link",
            "value": 0.049,
            "ci": [0.045, 0.053],
            "unit": "rad",
            "extra": {},
        }
    ]


def test_an_empty_file_has_no_effects(tmp_path: Path) -> None:
    """A diagnosis that found nothing writes a list without entries."""
    path = tmp_path / "effects.yaml"
    write_effects(path, [])
    assert load_effects(path) == []
    path.write_text("")
    assert load_effects(path) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("effect: backlash", "must be a list of effects"),
        ("- backlash", "entry 1: 'backlash' is not a mapping"),
        ("- {effect: backlash, value: [", "is not YAML"),
        ("- {effect: backlsh, where: a, value: 1}", "did you mean 'backlash'"),
        ("- {effect: backlash, wher: a, value: 1}", "unknown key 'wher'.*did you mean 'where'"),
        ("- {effect: backlash, where: a}", "the key 'value' is missing"),
        ("- {value: 1}", "the key 'effect' is missing"),
        ("- {effect: [a], value: 1}", "must be a name"),
        ("- {effect: backlash, where: 3, value: 1}", "where=3 must be a name or null"),
        ("- {effect: backlash, where: a, side: lnk, value: 1}", "did you mean 'link'"),
        ("- {effect: backlash, where: a, side: [link], value: 1}", "side="),
        ("- {effect: backlash, where: a, value: wide}", "value='wide' must be a finite number"),
        ("- {effect: backlash, where: a, value: .nan}", "value=nan must be a finite number"),
        ("- {effect: backlash, where: a, value: true}", "value=True must be"),
        (
            "- {effect: backlash, where: a, value: 3, unit: deg}",
            "expected the unit 'rad', got 'deg'",
        ),
        ("- {effect: cogging, where: a, value: 1, extra: {cnt: 3}}", "no extra 'cnt'"),
        ("- {effect: cogging, where: a, value: 1, extra: 3}", "extra=3 a mapping"),
        ("- {effect: cogging, where: a, value: 1, extra: {how: add, where: b}}", "cogging"),
        (f"- {{effect: backlash, value: 1, where: {NESTED}}}", r"where=\[.*\.\.\..* must be a nam"),
        ("- !!python/object/apply:os.system ['true']", "is not YAML"),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    """Each mistake is a sentence that names the file; nothing in a file is executed."""
    path = tmp_path / "effects.yaml"
    path.write_text(text)
    with pytest.raises(EffectError, match=message) as error:
        load_effects(path)
    assert str(path) in str(error.value)


def test_numbers_may_be_written_with_an_exponent(tmp_path: Path) -> None:
    """YAML takes 1e-3 for text; here it is a number."""
    path = tmp_path / "effects.yaml"
    path.write_text("- {effect: command_delay, value: 1e-3}\n- {effect: armature, value: -2E2}")
    assert [values for _, values in load_effects(path)] == [(0.001,), (-200.0,)]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    """The path and the reason are in the message."""
    with pytest.raises(EffectError, match=r"nothing\.yaml: No such file"):
        load_effects(tmp_path / "nothing.yaml")


def test_a_failed_write_leaves_the_former_file(tmp_path: Path, monkeypatch) -> None:
    """A reader sees the old file or the new one, never half of one, and no debris stays."""
    path = tmp_path / "effects.yaml"
    write_effects(path, every_kind()[:1])
    before = path.read_bytes()

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("envs.effects.file.os.replace", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_effects(path, every_kind())
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(EffectError, match="must be a finite number"):
        write_effects(path, [(make("gravity_tilt"), (np.nan, 0.0))])


def test_effects_of_a_file_act_in_any_plant(tmp_path: Path, bench) -> None:
    """A servo with the written gain sags as one whose gain was set."""
    path = tmp_path / "effects.yaml"
    write_effects(path, [(make("position_gain", where="servo"), (0.5,))])
    fixed = bench(gravity=9.81, fixed=load_effects(path))
    drawn = bench([make("position_gain", where="servo")], [[0.5]], gravity=9.81)
    ends = []
    for arm in (fixed, drawn):
        arm.reset()
        ends.append(arm.hold(0.0, 1.0)[0])
    assert ends[0] == ends[1]
    assert fixed.plant.space.size == 0


def test_places_of_a_file_are_checked_by_the_plant(tmp_path: Path, bench) -> None:
    """A place that the robot lacks is refused with the nearest that it has."""
    path = tmp_path / "effects.yaml"
    write_effects(path, [(make("coulomb_friction", where="hing"), (0.1,))])
    with pytest.raises(EffectError, match=r"no joint 'hing'.*did you mean 'hinge'"):
        bench(fixed=load_effects(path))


def test_nested_aliases_are_refused_in_a_short_sentence(tmp_path: Path) -> None:
    """Ten aliases of ten aliases, nine levels deep, stand for 10^10 names in 600 bytes."""
    nested = "&a0 [x]"
    for level in range(1, 10):
        nested += f", &a{level} [" + ", ".join([f"*a{level - 1}"] * 10) + "]"
    path = tmp_path / "bomb.yaml"
    path.write_text(f"- {{effect: backlash, value: 0.01, where: [{nested}]}}\n", encoding="utf-8")
    with pytest.raises(EffectError, match=r"where=.* must be a name or null") as refused:
        load_effects(path)
    assert len(str(refused.value)) < 1000


def test_the_folder_of_a_diagnosis_is_its_effects(tmp_path: Path) -> None:
    """Its effects.yaml is read; a folder without one is named with the file that it lacks."""
    with pytest.raises(EffectError, match=r"effects.yaml: No such file"):
        load_effects(tmp_path)
    write_effects(tmp_path / "effects.yaml", [(make("backlash", where="elbow"), (0.05,))])
    ((effect, values),) = load_effects(tmp_path)
    assert (effect.name, values) == ("backlash", (0.05,))
