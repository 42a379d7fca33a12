"""What is known of the calls that take files, and that the command line, manifests and `Settings` agree on it."""

import inspect
import subprocess
import sys
from dataclasses import fields

import pytest
import typer

import nonsac
from nonsac import cli, layouts, problems
from nonsac.calls.registry import CALLS
from nonsac.cli.manifest import columns_of
from nonsac.cli.options import initial_of
from nonsac.clouds.problem import OrientedRegistration
from nonsac.estimators.named import ESTIMATORS, default_estimator, estimators_for
from nonsac.method.settings import Settings, descriptions

POSES = ("relative_pose", "absolute_pose")
ROWS = (*POSES, "register_pairs")
SETTINGS = {each.name for each in fields(Settings)}

every_call = pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
call_of_rows = pytest.mark.parametrize("call", [CALLS[name] for name in ROWS], ids=ROWS)


def options_of(call):
    """The options of a command, as typer has them: from what is typed to the name of its value."""
    command = typer.main.get_command(cli.app).commands[call.command]
    return {option: parameter.name for parameter in command.params for option in parameter.opts}


# --- the calls --------------------------------------------------------------------------------------------------------


def test_the_calls_are_those_of_the_package():
    assert set(CALLS) == {*ROWS, "register_clouds"}
    for name, call in CALLS.items():
        assert call.name == name
        assert call.function is getattr(nonsac, name)
        assert call.command == name.replace("_", "-")


@call_of_rows
def test_a_call_of_rows_knows_its_layout_and_its_problem(call):
    problem = getattr(problems, call.problem_name)()
    assert call.layout is getattr(layouts, call.layout_name)
    assert problem.layout == call.layout
    assert call.minimal_size == problem.minimal_size
    assert len(call.cameras) == len(call.layout.cameras)


def test_clouds_have_no_layout():
    call = CALLS["register_clouds"]
    assert call.layout is None
    assert call.minimal_size == OrientedRegistration().minimal_size
    assert (call.images, call.cameras, call.more_files) == ((), (), ())


# --- what may be set --------------------------------------------------------------------------------------------------


@call_of_rows
def test_a_call_of_rows_takes_all_settings(call):
    assert set(call.settings) - set(call.own) == SETTINGS
    assert {name: call.settings[name] for name in SETTINGS} == descriptions()


def test_clouds_take_some_settings_and_describe_two_anew():
    call = CALLS["register_clouds"]
    assert set(call.settings) == {"samples", "sample_size", "workers", "rng", "progress"}
    for name in ("samples", "sample_size"):
        assert call.settings[name] is call.own[name] is not descriptions()[name]


@every_call
def test_what_may_be_set_are_parameters_of_the_function(call):
    parameters = inspect.signature(call.function).parameters
    assert set(call.settings) <= set(parameters)
    assert all(parameters[name].kind is inspect.Parameter.KEYWORD_ONLY for name in call.settings)


@every_call
def test_all_that_can_be_read_is_text_and_the_seed_has_its_name(call):
    assert set(call.texts.values()) == {name for name, each in call.settings.items() if each.read is not None}
    assert set(call.settings) - set(call.texts.values()) == {"progress"}
    assert {text: name for text, name in call.texts.items() if text != name} == {"seed": "rng"}


@every_call
def test_what_is_set_at_first_is_the_default_of_the_function(call):
    parameters = inspect.signature(call.function).parameters
    for name in call.texts.values():
        text, default = initial_of(call, name), parameters[name].default
        assert (default is None) if text is None else call.read(name, text) == default


@every_call
def test_arguments_are_what_a_job_takes(call):
    parameters = inspect.signature(call.function).parameters
    assert call.arguments[: len(call.images)] == call.images
    assert {*call.cameras, *call.settings} - {"workers", "progress"} <= set(call.arguments)
    assert not {"workers", "progress"} & set(call.arguments)
    assert set(call.arguments) - set(call.images) <= set(parameters)
    assert ("weights" in call.arguments) == (call.layout is not None)
    for name in call.arguments:
        assert nonsac.Job(call.name, **{name: None}).settings == {name: None}
    with pytest.raises(TypeError, match=f"^{call.name} has no setting 'workers' in a job; it has "):
        nonsac.Job(call.name, workers=1)


# --- from text --------------------------------------------------------------------------------------------------------

READ = {
    ("noise", "1e-3"): 0.001,
    ("samples", "auto"): "auto",
    ("samples", "7"): 7,
    ("sample_size", "auto"): "auto",
    ("sample_size", "5"): 5,
    ("draw", "blocks"): "blocks",
    ("max_samples", "12"): 12,
    ("max_uncertainty", "3"): 3.0,
    ("time_limit", "2"): 2.0,
    ("max_memory", "500 MB"): "500 MB",
    ("max_memory", "64000000"): "64000000",
    ("estimator", "ransac"): "ransac",
    ("rule", "most_inliers"): "most_inliers",
    ("rule", "tlp_0.30"): "tlp_0.3",
    ("refine", "none"): "none",
    ("workers", "2"): 2,
    ("workers", "tcp://host:8786"): "tcp://host:8786",
    ("rng", "0"): 0,
}


@call_of_rows
def test_a_setting_from_text(call):
    assert {name for name, _ in READ} == set(call.texts.values()) - {"scale"}
    for (name, text), expected in READ.items():
        value = call.read(name, text)
        assert value == expected
        assert type(value) is type(expected)
        descriptions()[name].check(value if name != "workers" else 1)


@pytest.mark.parametrize(("text", "scale"), [("free", None), ("1", 1.0), ("2.5", 2.5)])
def test_the_scale_from_text(text, scale):
    assert CALLS["register_pairs"].read("scale", text) == scale


REFUSED = {
    ("noise", "0"): "'0' is not a positive number",
    ("noise", "nan"): "'nan' is not a positive number",
    ("noise", "inf"): "'inf' is not a positive number",
    ("noise", "much"): "'much' is not a positive number",
    ("noise", ""): "'' is not a positive number",
    ("samples", "0"): "'0' is neither a number of at least 1 nor 'auto'",
    ("samples", "1.5"): "'1.5' is neither a number of at least 1 nor 'auto'",
    ("samples", "-1"): "'-1' is neither a number of at least 1 nor 'auto'",
    ("sample_size", "many"): "'many' is neither a number of at least LEAST nor 'auto'",
    ("sample_size", "0"): "'0' is neither a number of at least LEAST nor 'auto'",
    ("draw", "groups"): "'groups' is not one of rows, blocks",
    ("max_samples", "auto"): "'auto' is not a whole number of at least 1",
    ("time_limit", "-1"): "'-1' is not a positive number",
    ("max_memory", "lots"): "'lots' is no number of bytes, such as 500000000 or '500 MB'",
    ("estimator", "lmeds"): "'lmeds' is not one of ransac, pcr99",
    ("estimator", "RANSAC"): "'RANSAC' is not one of ransac, pcr99",
    ("rule", "best"): "rule must be one of most_inliers, ",
    ("rule", "tlp_x"): "rule must be one of most_inliers, ",
    ("refine", "best"): "'best' is not one of union, polish, full, none",
    ("workers", "0"): "'0' is neither a number of at least 1 nor an address (tcp://host:8786)",
    ("workers", "all"): "'all' is neither a number of at least 1 nor an address (tcp://host:8786)",
    ("rng", "-1"): "'-1' is not a whole number of at least 0",
    ("rng", "None"): "'None' is not a whole number of at least 0",
}


@call_of_rows
@pytest.mark.parametrize(("name", "text"), REFUSED)
def test_text_that_is_no_setting(call, name, text):
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        call.read(name, text)
    expected = REFUSED[name, text].replace("LEAST", str(call.minimal_size))
    assert str(caught.value).startswith(expected)
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize("text", ["0", "-2", "inf", "fre", "None"])
def test_text_that_is_no_scale(text):
    with pytest.raises(ValueError, match=f"^'{text}' is neither a positive number nor 'free'$"):
        CALLS["register_pairs"].read("scale", text)


@call_of_rows
def test_a_sample_has_at_least_the_rows_of_a_minimal_one(call):
    least = call.minimal_size
    assert call.read("sample_size", str(least)) == least
    with pytest.raises(ValueError, match=f"'{least - 1}' is neither a number of at least {least} nor 'auto'"):
        call.read("sample_size", str(least - 1))


@pytest.mark.parametrize(("name", "least"), [("samples", 1), ("sample_size", 3)])
def test_clouds_count_for_themselves(name, least):
    call = CALLS["register_clouds"]
    assert call.read(name, str(least)) == least
    for text in (str(least - 1), "auto"):
        with pytest.raises(ValueError, match=f"^'{text}' is not a whole number of at least {least}$"):
            call.read(name, text)


@call_of_rows
def test_only_estimators_that_fit_are_read(call):
    problem = getattr(problems, call.problem_name)()
    fitting = estimators_for(problem)
    for name, named in ESTIMATORS.items():
        if not named.is_installed:
            continue
        if name in fitting:
            assert call.read("estimator", name) == name
            continue
        with pytest.raises(ValueError, match=f"^'{name}' is not for {call.command} ") as caught:
            call.read("estimator", name)
        assert str(caught.value).endswith(f"; use {default_estimator(problem)}")
    assert default_estimator(problem) in fitting


# --- the command line and manifests -----------------------------------------------------------------------------------


@every_call
def test_every_setting_is_an_option_and_a_column(call):
    options = options_of(call)
    expected = {"--" + text.replace("_", "-"): name for text, name in call.texts.items()}
    assert expected.items() <= options.items()
    others = {name.replace("-", "_").removeprefix("__") for name in set(options) - set(expected)}
    assert not others & (SETTINGS | set(CALLS["register_pairs"].own))
    assert not {"--progress", "--rng"} & set(options)
    columns = columns_of(call)
    assert set(columns) == {*call.files, *call.more_files, *call.images, *call.cameras, *call.texts} - {"workers"}
    assert len(set(columns)) == len(columns)


@every_call
def test_images_and_cameras_of_manifests_are_options_too(call):
    named = {f"--{name}" for name in (*call.images, *call.cameras)}
    assert named <= set(options_of(call))


@every_call
def test_an_option_shows_what_the_setting_says(call):
    command = typer.main.get_command(cli.app).commands[call.command]
    shown = {parameter.name: parameter for parameter in command.params}
    for name in call.texts.values():
        description, option = call.settings[name], shown[name]
        assert option.metavar == description.form
        assert option.help.endswith(".")
        assert option.default == initial_of(call, name)
        assert option.default is not None or option.show_default == description.default


@pytest.mark.parametrize("module", ["nonsac.cli", "nonsac.calls.registry", "nonsac.method.settings"])
def test_to_import_it_is_to_import_nothing_heavy(module):
    code = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert "nonsac" in loaded
    assert not loaded & {"numba", "numpy", "scipy", "matplotlib", "h5py", "sqlite3", "pyarrow", "fsspec", "rich"}
