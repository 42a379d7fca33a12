"""The command line. Results go to stdout, everything else to stderr.

Exit 0: trusted. 1: not trusted. 2: bad input. 3: an unexpected error. 130 and 143: interrupted, or told to end.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from typing import Annotated, Any

import typer

# The rest of nonsac is imported where it is needed: `--help` and a mistyped option answer at once.
from nonsac.cli.batch import batch
from nonsac.cli.compare import compare
from nonsac.cli.localize import localize
from nonsac.cli.messages import to_stderr, to_stdout
from nonsac.cli.planning import plan
from nonsac.cli.poses import absolute_pose, relative_pose
from nonsac.cli.registration import demo, register_clouds, register_pairs
from nonsac.cli.reproduce import section5, table2, table3
from nonsac.cli.simulate import simulate
from nonsac.cli.streams import unbroken_streams
from nonsac.cli.termination import Terminated, termination_raised
from nonsac.cli.verify import verify
from nonsac.cli.warmup import warmup

# Click's own type, which newer versions of typer carry inside themselves.
_UsageError: Any = typer.BadParameter.__bases__[0]

_UNEXPECTED, _INTERRUPTED = 3, 130
_DEBUG = "--debug"

_SETTINGS: dict[str, Any] = {
    "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["--help", "-h"]},
}
app = typer.Typer(help="Robust geometric estimation from data too large or too dirty for anything else.", **_SETTINGS)
commands = (
    register_clouds,
    register_pairs,
    relative_pose,
    absolute_pose,
    batch,
    verify,
    localize,
    plan,
    compare,
    simulate,
    demo,
    warmup,
)
for command in commands:
    app.command()(command)
reproduce = typer.Typer(help="Run the paper's experiments.", add_completion=False, **_SETTINGS)
for experiment in (table2, table3, section5):
    reproduce.command()(experiment)
reproduce.command("table4", hidden=True)(table3)  # what it was called before
app.add_typer(reproduce, name="reproduce")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows `nonsac`; by default that of the process.

    Returns
    -------
    int
        The exit code: 0 trusted, 1 not trusted, 2 bad usage or input, 3 an unexpected error, 130 interrupted, 143
        told to end.
    """
    words, debug = _without_debug(sys.argv[1:] if arguments is None else arguments)
    with unbroken_streams(), termination_raised():
        try:
            return _run(words)
        except Terminated as signal:
            to_stderr("told to end")
            return signal.exit_code
        except Exception as error:
            if debug:
                traceback.print_exc()
            to_stderr(_unexpected(error, debug))
            return _UNEXPECTED


def _run(arguments: Sequence[str]) -> int:
    try:
        code = int(app(arguments, prog_name="nonsac", standalone_mode=False) or 0)
        sys.stdout.flush()  # while a full disk can still be told
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    except _UsageError as error:
        to_stderr(error.format_message())
        return 2
    except OSError as error:
        to_stderr(f"{error.filename}: {error.strerror}" if error.filename else str(error))
        return 2
    except ValueError as error:
        to_stderr(str(error))
        return 2
    if code == _INTERRUPTED:  # some versions of typer raise, others return it
        to_stderr("interrupted")
    return code


def _without_debug(arguments: Sequence[str]) -> tuple[list[str], bool]:
    """The arguments without --debug, which may stand anywhere."""
    words = list(arguments)
    end = words.index("--") if "--" in words else len(words)
    return [word for word in words[:end] if word != _DEBUG] + words[end:], _DEBUG in words[:end]


def _unexpected(error: Exception, debug: bool) -> str:
    if isinstance(error, MemoryError):
        reason = f"not enough memory ({error})" if str(error) else "not enough memory"
    else:
        reason = f"unexpected error: {type(error).__name__}: {error}"
    return reason if debug else f"{reason} ({_DEBUG} shows where)"


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        to_stdout(f"nonsac {version('nonsac')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _nonsac(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    debug: Annotated[bool, typer.Option(_DEBUG, help="Show where an unexpected error came from.")] = False,
) -> None:
    _help_without_command(context)


@reproduce.callback(invoke_without_command=True)
def _reproduce(context: typer.Context) -> None:
    _help_without_command(context)


def _help_without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        to_stdout(context.get_help())
