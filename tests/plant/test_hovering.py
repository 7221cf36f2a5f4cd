"""A hovering body seen below its centre of mass: its zeros are those of a pendulum, in air of any density."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear.zeros import zero_report
from invtrack.plant.equilibrium.trim import trim
from invtrack.plant.linearize import linearize
from invtrack.plant.plant import Plant
from invtrack.references.profiles import rest_to_rest

XML = """<mujoco><option density="{density}" viscosity="{viscosity}"/><worldbody><body name="v" pos="0 0 1"><freejoint name="f"/>
<geom type="box" size=".2 .2 .02" pos="0 0 .05" mass="1"/><site name="s"/><site name="c" pos="0 0 .05"/></body></worldbody>
<actuator><motor name="t" site="c" gear="0 0 1 0 0 0"/><motor name="r" site="c" gear="0 0 0 1 0 0"/>
<motor name="p" site="c" gear="0 0 0 0 1 0"/><motor name="w" site="c" gear="0 0 0 0 0 1"/></actuator>
<sensor><framequat name="q" objtype="site" objname="s"/></sensor></mujoco>"""


@pytest.mark.parametrize(("density", "viscosity"), [(0.0, 0.0), (1.225, 1.8e-5), (1000.0, 1e-3)])
def test_zeros_are_transmission_zeros_and_can_be_moved(tmp_path: Path, density: float, viscosity: float) -> None:
    """Seen l = 5 cm below the centre of mass it turns about, by a thrust along itself: zeros +-sqrt(g / l), along x and along y."""
    path = tmp_path / "hover.xml"
    path.write_text(XML.format(density=density, viscosity=viscosity))
    plant = Plant.from_xml(path, inputs=["t", "r", "p", "w"], outputs=["site:s:x", "site:s:y", "site:s:z", "q[3]"])
    model = linearize(trim(plant).plant)
    assert model.operating_point.u0 == pytest.approx([9.81, 0, 0, 0], abs=1e-2)  # but for what the air carries
    report = zero_report(model)
    assert [zero.kind for zero in report.zeros] == ["transmission zero"] * 4
    rate = np.sqrt(9.81 / 0.05)
    tolerance = 1e-3 if density < 10 else 0.1  # water drags along
    np.testing.assert_allclose([zero.value for zero in report.zeros], np.array([-1, -1, 1, 1]) * rate, rtol=tolerance)
    assert report.preactuation_time == pytest.approx(np.log(100.0) / rate, rel=tolerance)
    y_0 = model.operating_point.y0
    plan = modified_inversion(model, rest_to_rest(y_0, y_0 + np.eye(4)[0], 3.0), axis_distance=20.0, real_part=30.0)
    assert plan.certificate.dynamics_residual < 1e-8
