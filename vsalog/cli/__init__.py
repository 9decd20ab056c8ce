"""The command line: one thin module per command, heavy imports inside the commands."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from _thread import get_ident, interrupt_main, start_new_thread
from contextlib import suppress
from io import TextIOWrapper
from typing import TYPE_CHECKING, NoReturn

import rich_click as click

from vsalog._version import __version__
from vsalog.cli.batch import batch
from vsalog.cli.compare import compare
from vsalog.cli.diagnose import diagnose
from vsalog.cli.estimate import estimate
from vsalog.cli.explain import explain
from vsalog.cli.export import export
from vsalog.cli.faults import bug, debugging
from vsalog.cli.help import dress
from vsalog.cli.identify import identify
from vsalog.cli.init import init
from vsalog.cli.inspect import inspect
from vsalog.cli.messages import Commands, message_options
from vsalog.cli.plan import plan
from vsalog.cli.plot import plot
from vsalog.cli.reproduce import reproduce
from vsalog.cli.simulate import simulate
from vsalog.cli.validate import validate
from vsalog.cli.warm import warm
from vsalog.core.errors import VsalogError, words_of
from vsalog.core.printable import printable
from vsalog.report.verbosity import Verbosity, ask

if TYPE_CHECKING:
    from sys import UnraisableHookArgs


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]}, params=message_options())
@click.version_option(__version__, prog_name="vsalog")
def cli() -> None:
    """Stiffness, with honest uncertainty, from the recordings of compliant robot joints."""


cli.add_command(batch)
cli.add_command(compare)
cli.add_command(diagnose)
cli.add_command(estimate)
cli.add_command(explain)
cli.add_command(export)
cli.add_command(identify)
cli.add_command(init)
cli.add_command(inspect)
cli.add_command(plan)
cli.add_command(plot)
cli.add_command(reproduce)
cli.add_command(simulate)
cli.add_command(validate)
cli.add_command(warm)
dress(cli)


def main() -> NoReturn:
    """Run the command line.

    Exit code 2 and a message on stderr where the input or the command line is to blame, 130 and 143 when interrupted or
    terminated, 141 when the reader of the output closed it, 1 for a bug of ours.
    """
    # The matrices are small: threads of linear algebra would only wait for one another, at a third of a command's processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A request to end (SIGTERM) cleans up as an interrupt does, so that no temporary file stays behind.
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), lambda number, _: sys.exit(128 + number))
    sys.unraisablehook = _raise_again
    # With a closed stream, as with ">&-", Python has no stream object.
    sys.stdout = sys.stdout or os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    sys.stderr = sys.stderr or os.fdopen(os.open(os.devnull, os.O_WRONLY), "w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files may have bytes that are no text
    code = _run()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    # Everything is written and closed. Arrow's own threads may still be letting go of Python objects, which aborts the process
    # when the interpreter is being taken down at that moment: so it is not taken down.
    os._exit(code)


def _raise_again(lost: UnraisableHookArgs) -> None:
    """Let a signal come again that came where nothing can be raised, as in a callback of the locks of an import."""
    if isinstance(lost.exc_value, KeyboardInterrupt):
        number = signal.SIGINT
    elif isinstance(lost.exc_value, SystemExit) and isinstance(lost.exc_value.code, int) and lost.exc_value.code > 128:
        number = signal.Signals(lost.exc_value.code - 128)
    else:
        sys.__unraisablehook__(lost)
        return
    # By another thread: raised here, it would be lost once more.
    if hasattr(signal, "pthread_kill"):
        start_new_thread(signal.pthread_kill, (get_ident(), number))
    else:
        start_new_thread(interrupt_main, (number,))


def _run() -> int:
    ask(Verbosity.NORMAL)
    try:
        code = cli(prog_name="vsalog", standalone_mode=False)
        sys.stdout.flush()
    except SystemExit as end:
        # rich and click end with 1, a bug's code, where a reader such as "head" closed the pipe.
        if isinstance(end.__context__, BrokenPipeError):
            return _closed()
        return end.code if isinstance(end.code, int) else 1
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("vsalog: interrupted; no file is half written", err=True)
        return 130
    except BrokenPipeError:
        return _closed()
    except Exception as error:
        if debugging():
            traceback.print_exc()
        return _explain(error)
    return code if isinstance(code, int) else 0


def _closed() -> int:
    """Return the exit code where the reader of the output closed it, which is that of SIGPIPE, also where there is none."""
    return 128 + getattr(signal, "SIGPIPE", 13)


def _explain(error: Exception) -> int:
    if isinstance(error, VsalogError | OSError):
        click.echo(f"vsalog: {printable(words_of(error))}", err=True)
        return 2
    click.echo(bug(f"{type(error).__name__}: {error}"), err=True)
    return 1
