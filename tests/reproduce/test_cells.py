"""One trial of one cell, against a slow account of the same."""

from dataclasses import replace

import numpy as np
import pytest

from nonsac.evaluation import rotation_error
from nonsac.method.scoring import MinimumMean, MostInliers, TruncatedLp
from nonsac.method.search import SampleTask
from nonsac.problems import Noise
from nonsac.reproduce import cells
from nonsac.reproduce.cells import RULES, Cell, run_trial
from nonsac.reproduce.experiments import EXPERIMENTS, chosen
from nonsac.sources import ArraySource

COUNTS = (2, 5)


@pytest.fixture(params=EXPERIMENTS)
def experiment(request):
    return EXPERIMENTS[request.param]


def cell_of(experiment, number=0):
    """A hard cell, in which samples fail."""
    return Cell(experiment, experiment.outlier_ratios[-1], experiment.noises[number], COUNTS, experiment.sample_size)


def hypotheses_of(cell, seed, number):
    """What `run_trial` should have drawn and found."""
    rng = cell.generator(seed, number)
    rows, truth = cell.experiment.simulate(5 * cell.sample_size, cell.outlier_ratio, cell.noise, rng)
    seed = int(rng.integers(2**63))
    parts = (cell.experiment.problem, cell.experiment.estimator, Noise.given(cell.noise), cell.sample_size, seed)
    task = SampleTask(ArraySource(rows), *parts)
    return task, [task(i) for i in range(5)], truth


def test_every_rule_sees_the_first_samples_only(experiment):
    cell = cell_of(experiment)
    trial = run_trial(cell, 7, 3)
    task, found, truth = hypotheses_of(cell, 7, 3)
    errors = [rotation_error(h.model[:, :3], truth[:3, :3]) for h in found]
    assert sorted(trial.errors) == sorted(trial.seconds) == sorted(trial.claimed) == list(COUNTS)
    for m in COUNTS:
        assert tuple(trial.errors[m]) == RULES
        assert trial.errors[m]["ideal"] == np.nanmin(errors[:m])
        most = max(range(m), key=lambda i: found[i].num_inliers)
        assert trial.errors[m]["most_inliers"] == errors[most]
        fixed = replace(task, estimator=experiment.estimator.with_budget(m))(0)
        assert trial.errors[m]["fixed"] == rotation_error(fixed.model[:, :3], truth[:3, :3])
        chosen = {error for rule, error in trial.errors[m].items() if rule not in ("fixed", "refined")}
        assert chosen <= set(errors[:m])
        assert set(trial.seconds[m]) == {"hypotheses", "fixed", "refined"}
    assert trial.seconds[2]["hypotheses"] < trial.seconds[5]["hypotheses"]


def test_samples_share_no_row(experiment):
    task, found, _ = hypotheses_of(cell_of(experiment), 0, 0)
    positions = np.sort([task.position(i) for i in range(5)])
    np.testing.assert_array_equal(np.diff(positions), experiment.sample_size)
    assert positions[-1] + experiment.sample_size == 5 * experiment.sample_size
    assert len(found[0].residuals) == experiment.sample_size


def test_the_rules_see_squared_sampson_errors():
    relative = EXPERIMENTS["relative-pose"]
    cell = cell_of(relative, -1)
    _, found, truth = hypotheses_of(cell, 1, 0)
    selected = cells.selected_models(cells._as_the_rules_see(found, relative), relative.problem, truth)
    squared = [replace(h, residuals=h.residuals**2, threshold=h.threshold**2) for h in found]
    for rule in (MinimumMean(), TruncatedLp(2.0)):
        best = int(np.argmax(rule.scores(squared, relative.problem)))
        np.testing.assert_array_equal(selected[rule.name], found[best].model)
    # The exponent p of squares is 2 p of lengths, and counting does not change.
    lengths = TruncatedLp(2.0).scores(found, relative.problem)
    np.testing.assert_allclose(TruncatedLp(1.0).scores(squared, relative.problem), lengths)
    np.testing.assert_array_equal(
        MostInliers().scores(squared, relative.problem), MostInliers().scores(found, relative.problem)
    )
    assert [e.residual_power for e in EXPERIMENTS.values()] == [2, 1, 1]


def test_a_trial_depends_on_its_number_its_seed_and_its_cell_alone(experiment):
    cell = cell_of(experiment)
    alone = replace(cell, counts=(5,))

    def drawn(cell, seed, number):
        return cell.generator(seed, number).random()

    assert run_trial(cell, 2, 4).errors[5] == run_trial(alone, 2, 4).errors[5]
    values = {drawn(cell, s, n) for s in range(3) for n in range(3)}
    values |= {drawn(replace(cell, noise=0.3), 0, 0), drawn(replace(cell, outlier_ratio=0.3), 0, 0)}
    values |= {drawn(replace(cell, sample_size=77), 0, 0)}
    assert len(values) == 12


def test_easy_data_are_solved_by_all_rules(experiment):
    cell = Cell(experiment, 0.2, experiment.noises[0] / 10, (3,), experiment.sample_size)
    trial = run_trial(cell, 0, 0)
    assert max(trial.errors[3].values()) < 1.0
    assert trial.claimed == {3: True}


def test_names():
    assert [e.name for e in chosen(["registration", "relative-pose"])] == ["relative-pose", "registration"]
    for names, message in ((["pnp"], "got 'pnp'"), ([], "got none")):
        with pytest.raises(ValueError, match=message):
            chosen(names)
