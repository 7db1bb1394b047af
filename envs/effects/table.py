"""The table of all effects for `docs/effects.md`, generated from the classes.

python -c "from envs.effects.table import page; open('docs/effects.md', 'w').write(page())"
"""

from collections.abc import Iterable, Sequence

from envs.effects import EFFECTS, Effect

INTRODUCTION = """# Effects

An effect is one named way in which a robot differs from its model. This page says how effects are
used, in which order they act, how to write your own, and what each one is. Randomization draws
their values, training adapts to them, evaluation sweeps them, and a diagnosis finds which of them
are present. The page is generated from the classes in `envs/effects` (`envs.effects.table`). To
leave an effect out of a diagnosis, or to train with what a diagnosis found:

```
sim2real diagnose LOG.csv MODEL.xml exclude=[backlash]
sim2real +experiment=udr effects=outputs/diagnose/default/<time>/effects.yaml
```

"""
HEAD = """## How to use them

```python
from envs.effects import load_effects, make

effect = make("stribeck_friction", where="elbow", free=("speed",))  # value and speed are drawn
plant = Plant(spec, [effect, make("link_mass", where="forearm", how="scale")], num_rows=256)
plant = Plant(spec, fixed=load_effects("effects.yaml"))             # as a diagnosis found them
```

* **where** is the name of a joint, actuator, body or geom. For effects that write one model field
  it may be a pattern, such as `hip_*`: one value for all that match. Without it a joint effect acts
  on every hinge and slide that an actuator drives, and an actuator effect on every actuator that
  can have it, with one value for all. A diagnosis tries that as well, for friction, inertia, play,
  springs and actuators.
* **how** a value changes the model: `add`, `scale` or `set`. The first one listed is the default,
  and the one that `effects.yaml` uses.
* **neutral** values (0 added, factor 1, the model's own) leave a plant bit for bit as it is without
  the effect; `backlash` and `joint_compliance`, which add a joint, to 1e-7 rad. Give a plant
  only the effects that you need: with a substep rule the engine is called once per substep.
* **extras** are constants given as arguments, or parameters of their own if listed in `free`. A
  `Draw` has one range for all parameters of its effect, so leave them constant there.
* Several effects at one place compose in the order given, fixed ones first: each adds to or scales
  the result of those before it. The same effect, once fixed and once drawn, composes if it adds or
  scales, and is refused if it sets.

## Order within a control step

1. The command as it arrives: `packet_loss`, then the shift by a servo's `encoder_offset`.
2. Before each physics substep: the goal's profile (`profile_velocity`, `profile_acceleration`), a
   servo's feedback through play or a spring on the link's side, `dead_zone`, the weakening by
   `supply_sag` and `thermal_derating`, friction (`stribeck_friction`, `load_dependent_friction`),
   applied torques (`cogging`). Sums of torques and currents are those of the previous substep.
3. `command_delay` is the engine's own delay line. It comes after the profile, which makes no
   difference to the motion: the profile does not depend on when it runs.
4. After the step, what the sensors report: on the motor's side of play or a spring, sampled in the
   past (`observation_delay`), plus `encoder_offset`, plus `sensor_noise`, rounded (`quantization`);
   the speed filtered (`velocity_filter`). This happens once per control step: reading twice returns
   the same values.

## Your own effect

Write one class and register it. It is then known to `make`, randomization, evaluation grids,
`effects.yaml`, diagnosis, reports and, where MJCF can express it, `model.xml`.

```python
from envs.effects import FieldEffect, register


@register
class SpringStiffness(FieldEffect):
    \"\"\"The stiffness of a joint's spring.\"\"\"

    name, place, unit = "spring_stiffness", "joint", "N·m/rad"
    hows = ("scale", "add", "set")
    field = "jnt_stiffness"
    symptom = "the joint is pulled to its rest angle more or less strongly"
    source = "MuJoCo XML reference, joint/stiffness"
    experiment = "let go of the joint from several angles"
```

Optional attributes and methods of the class:

* For diagnosis: `limits` of its value; `first_values`, which a search tries first, or
  `probes(scale)` where they depend on the robot's sizes (`RobotScale`; by default they follow from
  `typical`); `places(scale)` and `variants(scale)`, where and with which arguments it is tried;
  `shared`, whether one value for all places is tried; `fit` of an `Extra`, the range in which a
  further scalar is fitted; `group`, which effects can be simulated beside it.
  `visible_in_replay = False` leaves it out of a search, as for noise.
* For `model.xml`: `no_mjcf`, None if the model fields that it writes express it, else why MJCF
  cannot; `own_mjcf` and `to_mjcf` if the class writes its own MJCF.
* For reports: `display_name`, its name in a sentence.
* For the exam, if the emulator has a law for it: `sizes`, `draw_extras`, `typical` of an `Extra`,
  `comparable`.

"""
TITLES = ("How to use them", "Order within a control step", "Your own effect", "All effects")
ACTS_ON = {
    "joint": "Joints",
    "actuator": "Actuators",
    "body": "Bodies",
    "contact": "Contacts",
    "robot": "The whole robot",
}


def page() -> str:
    """Return the whole page."""
    every = EFFECTS.values()
    body = HEAD + "## All effects\n\n" + table(every) + "\n" + sections(every)
    return INTRODUCTION + contents(every) + "\n" + body


def contents(effects: Iterable[type[Effect]]) -> str:
    """Return links to the page's sections and to its effects, by what they act on."""
    sections = [f"[{title}](#{title.lower().replace(' ', '-')})" for title in TITLES]
    lines = ["* " + ", ".join(sections)]
    for place, title in ACTS_ON.items():
        links = [f"[`{e.name}`](#{e.name})" for e in effects if e.place == place]
        lines.append(f"* {title}: {', '.join(links)}")
    return "\n".join(lines) + "\n"


def table(effects: Iterable[type[Effect]]) -> str:
    """Return one row an effect, in Markdown."""
    rows = [("effect", "where", "value", "how", "side", "extras")]
    rows += [
        (
            f"[`{e.name}`](#{e.name})",
            e.place,
            _unit(e) or "–",
            ", ".join(e.hows),
            ", ".join(e.sides) or "–",
            ", ".join(f"`{x.name}`" + (f" {x.unit}" if x.unit else "") for x in e.extras) or "–",
        )
        for e in effects
    ]
    return _markdown(rows)


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    lines.insert(1, "|" + "---|" * len(rows[0]))
    return "\n".join(lines) + "\n"


def sections(effects: Iterable[type[Effect]]) -> str:
    """Return what each effect is, its symptom and source, and how to isolate it."""
    return "\n".join(_section(effect) for effect in effects)


def _section(effect: type[Effect]) -> str:
    lines = [f"### {effect.name}\n", f"{_docstring(effect)}\n"]
    unit = f" {_unit(effect)}" if _unit(effect) else ""
    low, high = effect.typical
    lines.append(f"* Symptom: {effect.symptom}.")
    lines.append(f"* Isolate it: {effect.experiment}.")
    lines.append(f"* Equation, source: {effect.source}.")
    lines.append(f"* Typical: {low:g} to {high:g}{unit} ({effect.hows[0]}).")
    for e in effect.extras:
        default = "no default" if e.default is None else f"default {e.default:g}"
        lines.append(f"* `{e.name}`{f' [{e.unit}]' if e.unit else ''}: {e.about}; {default}.")
    return "\n".join(lines) + "\n"


def _unit(effect: type[Effect]) -> str:
    """Return the effect's unit; "" for a number without one."""
    return "" if effect.unit in ("1", "factor") else effect.unit


def _docstring(effect: type[Effect]) -> str:
    """Return the class's docstring without its Args, a paragraph a line."""
    text = (effect.__doc__ or "").split("Args:")[0].strip()
    paragraphs = [" ".join(part.split()) for part in text.split("\n\n")]
    return "\n\n".join(part for part in paragraphs if part)
