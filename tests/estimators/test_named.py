import pytest

import naive
from nonsac import AbsolutePose, Estimator, External, Pcr99, Ransac, Registration, RelativePose
from nonsac.clouds.problem import OrientedRegistration
from nonsac.estimators.named import ESTIMATORS, Named, chosen_estimator, default_estimator, estimators_for

PROBLEMS = [Registration(), Registration(None), RelativePose(), AbsolutePose(), naive.Shift(), naive.Line()]
problems = pytest.mark.parametrize("problem", PROBLEMS, ids=lambda problem: type(problem).__name__)


class Picky(Estimator):
    """Solves registrations only."""

    def estimate(self, problem, rows, noise, rng):
        raise AssertionError("was used")

    def check(self, problem):
        if not isinstance(problem, Registration):
            raise ValueError(f"Picky does not like {type(problem).__name__}")


def find(values, threshold, seed):
    return None


# --- names ------------------------------------------------------------------------------------------------------------


def test_pcr99_is_the_default_for_registrations_and_ransac_for_everything_else():
    assert default_estimator(Registration()) == default_estimator(Registration(None)) == "pcr99"
    for problem in (RelativePose(), AbsolutePose(), OrientedRegistration(), naive.Shift(), naive.Line()):
        assert default_estimator(problem) == "ransac"


@problems
def test_the_default_is_the_one_of_its_name(problem):
    assert chosen_estimator(None, problem) == chosen_estimator(default_estimator(problem), problem)


@problems
@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_name_gives_an_estimator_for_the_problems_that_it_fits(name, problem):
    named = ESTIMATORS[name]
    if not named.fits(problem):
        with pytest.raises(TypeError, match=rf"^{name} is for .*, got {type(problem).__name__}$"):
            chosen_estimator(name, problem)
    elif named.is_installed:
        estimator = named.made_for(problem)
        assert isinstance(estimator, Estimator)
        if problem != Registration(None):  # some need a scale, and say so
            assert estimator.check(problem) is None
    else:
        with pytest.raises(ValueError, match=rf'^{name} needs .*: pip install "nonsac\[{named.extra}\]"$'):
            chosen_estimator(name, problem)


def test_names_are_listed_with_what_they_are():
    assert estimators_for(Registration())[:2] == ["ransac", "pcr99"]
    assert "pcr99" not in estimators_for(RelativePose())
    for named in ESTIMATORS.values():
        assert named.about
        assert "\n" not in named.about
        assert (named.needs is None) == (named.extra is None)


def test_what_is_not_installed_is_refused_with_the_extra_that_installs_it(monkeypatch):
    missing = Named("ransac:default", "nobody's", needs="no_such_module", extra="none")
    monkeypatch.setitem(ESTIMATORS, "missing", missing)
    assert not missing.is_installed
    message = r'^missing needs no_such_module, which is not installed: pip install "nonsac\[none\]"$'
    with pytest.raises(ValueError, match=message):
        chosen_estimator("missing", RelativePose())


def test_pcr99_compares_distances_if_the_scale_is_known():
    assert chosen_estimator("pcr99", Registration()) == Pcr99.for_pairs()
    assert chosen_estimator("pcr99", Registration(2.5)) == Pcr99.for_pairs()
    assert chosen_estimator("pcr99", Registration(None)) == Pcr99()


@pytest.mark.parametrize("problem", [Registration(), AbsolutePose(), naive.Shift(), naive.Line()])
def test_ransac_stops_early_and_optimises(problem):
    expected = Ransac(20_000, confidence=0.9999, local_optimisation=True, least_iterations=100)
    assert chosen_estimator("ransac", problem) == expected


def test_ransac_searches_longer_for_a_relative_pose():
    expected = Ransac(20_000, confidence=0.9999, local_optimisation=True, least_iterations=1000)
    assert chosen_estimator("ransac", RelativePose()) == expected


@pytest.mark.parametrize("name", ["", "RANSAC", "no_such", "pcr-99"])
def test_an_unknown_name_is_refused_with_those_that_fit(name):
    with pytest.raises(ValueError, match=r"estimator must be one of ransac, pcr99.* or an object, got") as caught:
        chosen_estimator(name, Registration())
    assert repr(name) in str(caught.value)


# --- objects and functions --------------------------------------------------------------------------------------------


@problems
def test_an_object_is_taken_as_it_is(problem):
    estimator = Ransac(7)
    assert chosen_estimator(estimator, problem) is estimator


def test_a_function_becomes_an_estimator():
    assert chosen_estimator(find, Registration()) == External(find)
    external = External(find, needs="math")
    assert chosen_estimator(external, Registration()) is external


@pytest.mark.parametrize("wrong", [Ransac, Pcr99, Picky])
def test_a_class_in_place_of_an_object_is_refused_by_name(wrong):
    with pytest.raises(TypeError, match=f"derived from nonsac.Estimator, got the class {wrong.__name__}"):
        chosen_estimator(wrong, Registration())


def test_what_only_looks_like_an_estimator_is_refused_by_name():
    class Lookalike:
        estimate, check = Picky.estimate, Picky.check

    with pytest.raises(TypeError, match=r"estimator must be a name, a function .* nonsac\.Estimator, got Lookalike"):
        chosen_estimator(Lookalike(), Registration())


@pytest.mark.parametrize("wrong", [3, 0.5, ["ransac"], True, b"ransac"])
def test_anything_else_is_refused_by_its_type(wrong):
    with pytest.raises(TypeError, match=f"estimator must be a name, a function .*, got {type(wrong).__name__}"):
        chosen_estimator(wrong, Registration())


# --- what cannot work on the problem ----------------------------------------------------------------------------------


def test_an_estimator_has_the_last_word_on_the_problem():
    assert isinstance(chosen_estimator(Picky(), Registration()), Picky)
    with pytest.raises(ValueError, match="Picky does not like Shift"):
        chosen_estimator(Picky(), naive.Shift())


@pytest.mark.parametrize("problem", PROBLEMS[2:], ids=lambda problem: type(problem).__name__)
def test_pcr99_is_refused_for_all_but_registrations(problem):
    with pytest.raises(TypeError, match=f"Pcr99 estimates 3D registrations only, got {type(problem).__name__}"):
        chosen_estimator(Pcr99.for_pairs(), problem)


def test_distances_are_refused_for_a_free_scale():
    with pytest.raises(ValueError, match="needs a known scale"):
        chosen_estimator(Pcr99.for_pairs(), Registration(None))


def test_a_missing_module_is_refused_by_name():
    with pytest.raises(ValueError, match="needs the module no_such_module"):
        chosen_estimator(External(find, needs="no_such_module"), Registration())
