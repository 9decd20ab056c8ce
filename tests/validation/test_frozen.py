"""A model file edited by hand is refused in one line, before anything is written."""

import copy
import tomllib

import pytest
import tomli_w

from tests.validation.conftest import SAMPLES, call


def of(key, value, joint=False, basis=False):
    """Return a change of the first transmission, of the joint's basis, or of the joint."""

    def change(model):
        found = model["joint"]["vsa2"]
        (found if joint else found["basis"] if basis else found["transmission"][0])[key] = value

    return change


FAULTS = {
    "few coefficients": (of("coefficients", [0.1]), "1 coefficients for 4"),
    "nan coefficient": (of("coefficients", [float("nan"), 0.1, 0.1, 0.1]), "not finite"),
    "huge coefficients": (of("coefficients", [1e300] * 4), "too large"),
    "small covariance": (of("covariance", [[1.0, 2.0], [3.0, 4.0]]), "not 4 by 4"),
    "ragged covariance": (of("covariance", [[1.0], [3.0, 4.0], [], [1.0]]), "not 4 by 4"),
    "negative variance": (of("covariance", [[-1.0] * 4] * 4), "negative variance"),
    "asymmetric covariance": (
        of("covariance", [[float(i == j) + 20.0 * (i < j) for j in range(4)] for i in range(4)]),
        "not symmetric",
    ),
    "impossible correlation": (
        of("covariance", [[1.0 if i == j else -0.9 for j in range(4)] for i in range(4)]),
        "negative variance",
    ),
    "ragged region": (of("region", [[1.0], [1.0, 2.0]]), "region"),
    "region nan": (of("region", [[float("nan")], [1.0]]), "region"),
    "region of nothing": (of("region", [[], []]), "region"),
    "huge power": (of("powers", [1, 3, 5, 10**9], basis=True), "powers"),
    "no powers": (of("powers", [], basis=True), "powers"),
    "no set-point power": (of("setpoint_order", 0, basis=True), "setpoint_order"),
    "zero scale": (of("deflection_scale", 0.0, basis=True), "deflection_scale"),
    "branches without coefficients": (of("branches", True, basis=True), "4 coefficients for 8"),
    "other transmissions": (of("name", "left"), "transmissions 1, 2, but the model left, 2"),
    "no joint": (lambda model: model.update(joint={}), "no joint"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_model_whose_numbers_do_not_fit_is_refused(name, models, tmp_path):
    change, words = FAULTS[name]
    model = copy.deepcopy(tomllib.loads(models["vsa2"].read_text()))
    change(model)
    path = tmp_path / "edited.model.toml"
    path.write_text(tomli_w.dumps(model))
    result = call("validate", path, SAMPLES / "vsa2_exp2.mcap", "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert words in result.stderr
    assert "\n" not in result.stderr.strip()
    assert not (tmp_path / "out").exists()


def test_a_model_whose_rig_is_broken_is_refused_even_if_the_log_has_its_own(models, tmp_path):
    model = tomllib.loads(models["vsa2"].read_text())
    path = tmp_path / "edited.model.toml"
    for rig in ("joint = [", '[joint.vsa2]\nkind = "elastick"\n'):
        path.write_text(tomli_w.dumps({**model, "rig": rig}))
        result = call("validate", path, SAMPLES / "vsa2_exp2.mcap", "-o", tmp_path / "out")
        assert result.exit_code == 2
        assert "the rig in it" in result.stderr
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["x=" + "[" * 5000, "x=" + "9" * 5000])
def test_toml_beyond_the_parser_is_no_model(text, tmp_path):
    path = tmp_path / "deep.model.toml"
    path.write_text(text)
    result = call("validate", path, SAMPLES / "vsa2_exp2.mcap", "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert "is not a model file" in result.stderr
