"""How the command line is read, and what it says of itself: options, help, examples, exit status."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from ..files.errors import InputError

__all__ = ["EXIT_STATUS", "UNUSABLE", "Commands", "examples_text"]

UNUSABLE = 2  # exit status for input that cannot be used

EXIT_STATUS = """exit status, of every command:
  0      done
  1      a fault of this program, with a traceback: please report it
  2      input or usage that cannot be used; a line on standard error says what, and what to do.
         Of several bags: some could not be replayed, and the others were.
         Of a replay: a wheel has no output, and the others have; a line says why
  128+N  ended by signal N: 130 by Ctrl-C, 141 where the reader of a pipe has gone"""


class _Formatter(argparse.HelpFormatter):
    """Paragraphs are filled, but lines that begin with a space, and those below a line that ends with a colon."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = text.split("\n\n")
        return "\n\n".join(
            paragraph if "\n " in paragraph else super(_Formatter, self)._fill_text(paragraph, width, indent)
            for paragraph in paragraphs
        )


class _Parser(argparse.ArgumentParser):
    example = ""  # of a right call

    def error(self, message: str) -> NoReturn:
        """Refuse in words of our own where argparse's do not say what to do next."""
        wrong = re.fullmatch(r"argument (\S+): invalid (int|float) value: (.*)", message, re.DOTALL)
        if wrong:
            option, kind, value = wrong.groups()
            message = f"{option} is {value}; it must be a {'whole ' if kind == 'int' else ''}number"
        elif message.startswith("the following arguments are required: "):
            message = f"needs {message.partition(': ')[2]}" + (f"; such as {self.example}" if self.example else "")
        raise InputError(f"{message} (see {self.prog} --help)")

    def refuse_extra(self, extra: Sequence[str]) -> NoReturn:
        """Say which arguments nobody takes, and which was meant."""
        first = extra[0]
        if not first.startswith("-"):
            raise InputError(f"{first!r} is one argument too many (see {self.prog} --help)")
        name = first.partition("=")[0]
        known = [option for action in self._actions for option in action.option_strings]
        raise InputError(f"{name} is no option{_meant(name, known)} (see {self.prog} --help)")


def _meant(name: str, known: Sequence[str]) -> str:
    import difflib

    close = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {close[0]}?" if close else ""


class Commands:
    """The parser with its commands, which stand in groups in the help.

    Parameters
    ----------
    declare : callable
        Called with this; adds every command.
    first_steps : sequence of (str, str)
        Calls of a beginner, without ``tire-dynamics``, and what each does.
    """

    def __init__(self, declare: Callable[[Commands], None], first_steps: Sequence[tuple[str, str]]) -> None:
        self.parser = _Parser(
            prog="tire-dynamics", usage="tire-dynamics [-h] [--version] COMMAND ...", formatter_class=_Formatter
        )
        self.parser.add_argument("--version", nargs=0, action=_Version, help="say which version this is")
        # The list in the description has them by group.
        self.commands = self.parser.add_subparsers(
            dest="command", metavar="COMMAND", required=True, prog="tire-dynamics", help=argparse.SUPPRESS
        )
        self.help: dict[str, str] = {}
        self._groups: dict[str, list[str]] = {}
        declare(self)
        lines = ["What the tires do to the axles: live, from bags, and in theory."]
        lines += ["\n".join([f"{group}:", *members]) for group, members in self._groups.items()]
        self.parser.description = "\n\n".join(lines)
        self.parser.epilog = "\n\n".join(
            [examples_text(first_steps), EXIT_STATUS, "tire-dynamics COMMAND --help says more."]
        )

    def add(
        self, group: str, name: str, *, help: str, examples: Sequence[tuple[str, str]], description: str = ""
    ) -> _Parser:
        """Declare a command.

        Parameters
        ----------
        group : str
            The heading under which the help lists it.
        name, help : str
            As it is called, and what it does in a few words.
        examples : sequence of (str, str)
            Calls, without ``tire-dynamics``, and what each does. The first is shown to whoever leaves something out.
        description : str
            What it does, in sentences.
        """
        self._groups.setdefault(group, []).append(f"  {name:13} {help}")
        self.help[name] = help
        command: _Parser = self.commands.add_parser(
            name, help=help, description=description or None, epilog=examples_text(examples), formatter_class=_Formatter
        )
        command.example = f"tire-dynamics {examples[0][0]}"
        return command

    def parse(self, arguments: Sequence[str]) -> argparse.Namespace:
        """The options; ``InputError`` if the arguments are not what a command takes."""
        known = self.commands.choices
        name = next((each for each in arguments if not each.startswith("-")), None)
        if name is None and not {"-h", "--help", "--version"} & set(arguments):
            if arguments:
                self.parser.refuse_extra(arguments)
            raise InputError("a COMMAND is missing: tire-dynamics --help lists them")
        if name is not None and name not in known:
            meant = _meant(name, list(known))
            raise InputError(f"{name[:100]!r} is no COMMAND{meant or ': tire-dynamics --help lists them'}")
        options, extra = self.parser.parse_known_args(arguments)
        if extra:
            known[options.command].refuse_extra(extra)
        return options


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *arguments: Any) -> NoReturn:
        from .. import __version__

        print(f"tire-dynamics {__version__}")
        parser.exit()


def examples_text(examples: Sequence[tuple[str, str]]) -> str:
    """The examples of a command as lines of its help."""
    lines = ["examples:"]
    for call, what in examples:
        lines += [f"  # {what}"] if what else []
        lines.append(f"  tire-dynamics {call}")
    return "\n".join(lines)
