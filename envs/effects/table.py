"""The table of all effects for `docs/effects.md`, generated from the classes.

python -c "from envs.effects.table import page; open('docs/effects.md', 'w').write(page())"
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from envs.effects import EFFECTS, Effect

HEAD = """# Effects

One named way in which a robot differs from its model. Randomization draws their values, training
adapts to them, evaluation sweeps them, a diagnosis asks which of them are there. This page is made
from the classes in `envs/effects` (`envs.effects.table`); a test keeps it up to date.

```python
from envs.effects import load_effects, make

effect = make("stribeck_friction", where="elbow", free=("speed",))  # value and speed are drawn
plant = Plant(spec, [effect, make("link_mass", where="forearm", how="scale")], num_rows=256)
plant = Plant(spec, fixed=load_effects("effects.yaml"))             # as a diagnosis found them
```

* **where** is the name of a joint, actuator, body or geom. Without it a joint effect acts on every
  hinge and slide that an actuator drives, an actuator effect on every actuator that can have it,
  with one value for all; a diagnosis tries that too, for friction, inertia and actuators.
* **how** a value changes the model: the first way listed is the default, and the one that
  `effects.yaml` uses.
* **neutral** values (0 added, factor 1, the model's own) leave a plant as it is without the effect,
  to the last bit; `backlash` and `joint_compliance`, which add a joint, to 1e-7 rad. Give the
  effect to a plant only if it is wanted: with a substep rule the engine is called once a substep.
* **extras** are constants given as arguments, or parameters of their own if listed in `free`. A
  `Draw` has one range for all parameters of its effect, so leave them constant there.
* Several effects at one place compose in the order given, fixed ones first: each adds to or scales
  what those before it left. The same effect fixed and drawn composes where it adds or scales, and
  is refused where it sets.

## The order of things in a control step

1. What arrives of the command: `packet_loss`, then the shift by an `encoder_offset` of a servo.
2. Before each physics substep: the goal's profile (`profile_velocity`, `profile_acceleration`), a
   servo's feedback over a play or spring on the link's side, `dead_zone`, the weakening by
   `supply_sag` and `thermal_derating`, friction (`stribeck_friction`, `load_dependent_friction`),
   applied torques (`cogging`). Sums of torques and currents are those of the substep before.
3. `command_delay` is the engine's own delay line. It comes after the profile, which makes no
   difference to the motion: the profile does not depend on when it runs.
4. After the step, what the sensors say: on the motor's side of a play or spring, sampled in the
   past (`observation_delay`), plus `encoder_offset`, plus `sensor_noise`, rounded (`quantization`);
   the speed filtered (`velocity_filter`). Once a control step: reading twice says the same.

## An effect of your own

One class, registered once. It is then known to `make`, randomization, evaluation grids,
`effects.yaml`, diagnosis, reports and, where MJCF can say it, `model.xml`.

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

What else a class may say of itself:

* For diagnosis: `probes(scale)`, the values that span it on a robot, from the robot's sizes
  (`RobotScale`; left out, they follow from `typical`); `places(scale)` and `variants(scale)`, where
  and with which arguments it is tried; `shared`, whether one value for all places is tried as well;
  `fit` of an `Extra`, the range in which a further scalar is fitted; `batch()`, which effects can
  be simulated beside it; `servo_rank` and `tied`, whether it joins first where every joint is
  wrong, and from which factor. `closes_gaps = False` leaves it out, as noise is.
* For `model.xml`: `no_mjcf`, None if its model fields say it all, else the reason why MJCF cannot;
  `own_mjcf` and `to_mjcf` if it writes itself.
* For reports: `words`, its name in a sentence.
* For the exam, if the emulator has a law for it: `sizes`, `draw_extras`, `typical` of an `Extra`,
  `comparable`.

"""


def page() -> str:
    """Return the whole page."""
    return HEAD + "## All effects\n\n" + table(EFFECTS.values()) + "\n" + sections(EFFECTS.values())


def table(effects: Iterable[type[Effect]]) -> str:
    """Return one row an effect, in Markdown."""
    rows = [("effect", "where", "value", "how", "side", "extras")]
    rows += [
        (
            f"[`{e.name}`](#{e.name})",
            e.place,
            e.unit or "–",
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
    unit = f" {effect.unit}" if effect.unit else ""
    low, high = effect.typical
    lines.append(f"* Symptom: {effect.symptom}.")
    lines.append(f"* Isolate it: {effect.experiment}.")
    lines.append(f"* Equation, source: {effect.source}.")
    lines.append(f"* Typical: {low:g} to {high:g}{unit} ({effect.hows[0]}).")
    for e in effect.extras:
        default = "no default" if e.default is None else f"default {e.default:g}"
        lines.append(f"* `{e.name}`{f' [{e.unit}]' if e.unit else ''}: {e.about}; {default}.")
    return "\n".join(lines) + "\n"


def _docstring(effect: type[Effect]) -> str:
    """Return the class's docstring without its Args, a paragraph a line."""
    text = (effect.__doc__ or "").split("Args:")[0].strip()
    paragraphs = [" ".join(part.split()) for part in text.split("\n\n")]
    return "\n\n".join(part for part in paragraphs if part)
