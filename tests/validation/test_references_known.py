"""What the rig knows next to the springs is taken off what a model is compared with; what it does not know is not."""

import json

import pytest

from tests.validation.conftest import SAMPLES, call

pytestmark = pytest.mark.share(3)

MOTOR, SPRING = "joint.sea.motor.", "joint.sea.transmission."
# Each effect and the reference that it reaches.
EFFECTS = {
    "friction": (MOTOR + "friction={coulomb=0.3}", "residual"),
    "friction that grows with the load": (MOTOR + "friction={coulomb=0.1,load=0.15}", "residual"),
    "cogging": (MOTOR + "cogging=[{torque=0.3,order=6,phase=0.3}]", "residual"),
    "damping": (SPRING + "damping=2.5", "sensor"),
    "hysteresis": (SPRING + "bouc_wen={torque=0.4,width=0.02,exponent=1.5}", "sensor"),
    "slip": (SPRING + "slip=[{stiffness=30,limit=0.3}]", "sensor"),
    "damping, from the motor's side": (SPRING + "damping=2.5", "residual"),
    "hysteresis, from the motor's side": (SPRING + "bouc_wen={torque=0.4,width=0.02,exponent=1.5}", "residual"),
}


def simulated(folder, name, *actual):
    log = folder / f"{name}.mcap"
    options = [o for setting in actual for o in ("--actual", setting)]
    result = call("simulate", "sea", "--scenario", "sea-exp2", "--seed", "5", *options, "-o", log)
    assert result.exit_code == 0, result.output
    return log


def held(model, log, reference, folder, *known):
    """Return the error inside the region against a reference, with a rig that knows so much [%]."""
    options = [o for setting in known for o in ("--set", setting)]
    result = call("validate", model, log, "-o", folder, "--no-modalities", "--json", *options)
    assert result.exit_code == 0, result.output
    (part,) = json.loads(result.stdout)["logs"][0]["joints"][0]["transmissions"]
    (found,) = [c for c in part["comparisons"] if (c["reference"], c["quantity"]) == (reference, "flexibility_torque")]
    return found["inside"]


@pytest.fixture(scope="module")
def plain(models, tmp_path_factory):
    """The error without any effect: reference → score."""
    folder = tmp_path_factory.mktemp("plain")
    log = simulated(folder, "plain")
    return {reference: held(models["sea"], log, reference, folder) for reference in ("sensor", "residual")}


@pytest.mark.every(2)
@pytest.mark.parametrize("name", EFFECTS)
def test_a_known_effect_costs_nothing_and_an_unknown_one_does(name, models, plain, tmp_path):
    setting, reference = EFFECTS[name]
    log = simulated(tmp_path, "log", setting)
    known = held(models["sea"], log, reference, tmp_path, setting)
    unknown = held(models["sea"], log, reference, tmp_path)
    none = plain[reference]
    # As good as without it: within half of what was there already, and of most of the log.
    assert known["nrmse"]["value"] < 1.5 * none["nrmse"]["value"]
    assert known["samples"] > 0.5 * none["samples"]
    assert unknown["nrmse"]["low"] > 2.0 * known["nrmse"]["high"]


def test_friction_that_cannot_be_taken_off_leaves_the_sensor(models, tmp_path):
    """Friction that grows as fast as the torque leaves no residual; without the motor's inertia there is none anyway."""
    log = SAMPLES / "sea_exp2.bag"
    rig = tmp_path / "no_inertia.rig.toml"
    rig.write_text(
        '[joint.sea]\nkind = "elastic"\n[joint.sea.motor]\nfriction = { coulomb = 0.3 }\n[joint.sea.signals]\n'
        'motor_position = "/joint_states.position[motor]"\nlink_position = "/joint_states.position[link]"\n'
        'motor_torque = "/joint_states.effort[motor]"\ntorque_sensor = "/joint_torque.effort[transmission]"\n'
    )
    options = ("--no-modalities", "--json", "-o", tmp_path)
    for more in (("--set", MOTOR + "friction={load=1.0}"), ("--rig", rig)):
        result = call("validate", models["sea"], log, *options, *more)
        assert result.exit_code == 0, result.output
        (part,) = json.loads(result.stdout)["logs"][0]["joints"][0]["transmissions"]
        assert part["judged_on"] == "sensor"
        assert "residual" not in {c["reference"] for c in part["comparisons"]}
