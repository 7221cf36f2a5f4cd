"""The smallest study, to be copied: a flexible cantilever moves its tip by 2 m, by inversion, by feedback, and by both."""

import invtrack
from invtrack.figures import comparison_figure
from invtrack.studies import Case, Column, Setup, Study, StudyOptions, Table


def build(options: StudyOptions) -> Setup:
    plant = invtrack.Plant.from_xml(invtrack.model_path("cantilever"), inputs=["base_force"], outputs=["tip_position"])
    model = invtrack.linearize(plant)
    reference = invtrack.rest_to_rest(0.0, 2.0, duration=6.0)
    inverse, static = invtrack.invert(model, reference), invtrack.inversion.steady_state_feedforward(model, reference)
    gains = invtrack.lqr(model, Q=100.0, R=0.01)
    cases = [
        Case("inversion", plant, invtrack.TrackingController(inverse, gains)),
        Case("feedforward_only", plant, invtrack.TrackingController(inverse)),
        Case("feedback_only", plant, invtrack.TrackingController(static, gains)),
    ]
    columns = [Column("max error", "m"), Column("residual vibration", "m"), Column("peak input", "N")]
    figures = {"comparison": lambda done: comparison_figure(done.among(), window=(-5.0, 15.0))}
    return Setup(cases, figures=figures, report=[Table("Cantilever, 2 m in 6 s", columns)])


STUDY = Study("minimal", build, description=__doc__, defaults=StudyOptions(timestep=2e-3))

if __name__ == "__main__":
    STUDY.main()
