"""Whatever happens to a file, reading it ends soon, in little memory, with an answer or a documented error."""

import pytest

from fuzz import cases, formats, pool, run

_USUAL = 3500


@pytest.fixture
def inputs(request):
    return request.config.getoption("--fuzz") or _USUAL


def _installed(kinds):
    return [kind for kind in kinds if not cases.KINDS[kind].missing]


@pytest.mark.slow
def test_files(inputs, request, tmp_path_factory):
    counts = run.shared_out(inputs, _installed(formats.FORMATS))
    _check(pool.fuzz(counts, request.config.getoption("--seed")), request, tmp_path_factory)


@pytest.mark.slow
def test_arguments(inputs, request, tmp_path_factory):
    counts = run.shared_out(inputs, _installed(run.CALLS))
    _check(pool.fuzz(counts, request.config.getoption("--seed")), request, tmp_path_factory)


def _check(reports, request, tmp_path_factory):
    """Nothing failed; if something did, the inputs are kept, and the message says where."""
    folder, seed = tmp_path_factory.mktemp("failures"), request.config.getoption("--seed")
    lines = []
    for report in reports.values():
        for signature, seen in report.failures.items():
            number, failure = seen[0]
            run.save(folder / report.kind / str(number), report.kind, seed, number, failure)
            lines.append(f"{len(seen)} x {report.kind} {number}: {signature}")
    if lines:
        pytest.fail(f"python tests/fuzz/run.py --replay {folder}/KIND/NUMBER, of\n" + "\n".join(lines), pytrace=False)


@pytest.mark.parametrize("name", formats.FORMATS)
def test_whole_files_are_read(name, tmp_path):
    """A fuzzer of files that are refused at once finds nothing."""
    for library in formats.FORMATS[name].needs:
        pytest.importorskip(library)
    refused = []
    for files in formats.FORMATS[name].seeds():
        folder = tmp_path / str(len(refused))
        folder.mkdir()
        cases.write_files(folder, files)
        refused.append(all(_is_refused(read, folder) for read in formats.FORMATS[name].reads))
    assert not any(refused), refused


def _is_refused(read, folder):
    try:
        read(folder)
    except ValueError:
        return True
    return False
