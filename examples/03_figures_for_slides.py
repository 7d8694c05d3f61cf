"""Save one step of two filters as figures, and both runs over time: python 03_figures_for_slides.py [FOLDER]"""

import sys
from pathlib import Path

from pfviz import Trace, get_world, make_filter
from pfviz.figures import course_of, plot_courses, plot_step, render
from pfviz.randomness import step_rng

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
world, seed, last = get_world("figure-1"), 1, 40
film = world.record(seed, last)

courses = []
for name in ("basic-sir", "rb-hs-sir"):
    filter_ = make_filter(name, world.n_particles)
    trace = Trace(filter_.initial(step_rng(seed, 0), world.model))
    exact, errors, increments = world.model.prior, [], []
    for t, (observation, truth) in enumerate(zip(film.observations, film.truth, strict=True), start=1):
        record = filter_.step(step_rng(seed, t), world.model, trace.particles, observation)
        trace.append(record)
        errors.append(abs(float(record.estimate[0] - truth[0])))
        step = world.model.exact_step(exact, observation)
        assert step is not None  # this world is linear and Gaussian
        exact = step.posterior
        increments.append(step.log_evidence)
        if t == 8:
            figure = plot_step(record, world.model, truth, exact.leading(1), title=f"{name}, step {t}")
            for kind in ("png", "svg", "pdf"):
                (folder / f"{name}.{kind}").write_bytes(render(figure, kind))
    courses.append(course_of(trace, name, errors, increments))

(folder / "over-time.png").write_bytes(render(plot_courses(courses, title=world.title)))
print(
    "written:", ", ".join(sorted(path.name for path in folder.glob("*.*") if path.suffix in (".png", ".svg", ".pdf")))
)
