"""An argument parser with one-line errors, which rejects options without an effect."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn

from rr1plan.checks import resolved_path
from rr1plan.errors import InputError, UnknownNameError

# Before Python 3.14, argparse interprets such numbers, and lists with commas, as options unless a space precedes them.
_NEGATIVE = re.compile(r"-((\d+\.?\d*|\.\d+)(e[+-]?\d+(,.*)?|,.*)|inf|infinity|nan)$", re.IGNORECASE)


class Shown(Exception):
    """An option that prints a text and ends, like --help.

    Args:
        text: What to print.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        super().__init__(text)


class Parser(argparse.ArgumentParser):
    """Options are written in full, given once, and have an effect; anything else is an `InputError`.

    Attributes:
        details: Returns the last part of the help, which may need imports.
    """

    def __init__(self, **settings: Any) -> None:
        formatter = argparse.RawDescriptionHelpFormatter
        super().__init__(add_help=False, allow_abbrev=False, formatter_class=formatter, **settings)
        self.register("action", None, _Store)
        self.register("action", "store_true", _Flag)
        self.details: Callable[[], str] = str
        self._rules: list[Callable[[argparse.Namespace], str | None]] = []
        self.add_argument("-h", "--help", action=Show, text=self.full_help, help="show this help and exit")

    @property
    def options(self) -> tuple[str, ...]:
        """All options."""
        return tuple(self._option_string_actions)

    def full_help(self) -> str:
        """The help with its last part."""
        return f"{self.format_help()}\n{self.details()}\n"

    def error(self, message: str) -> NoReturn:
        """Reject a command line; argparse calls this when it cannot parse it."""
        missing = message.removeprefix("the following arguments are required: ")
        first = "" if missing.startswith("-") else ", give it first"
        words = message.removeprefix("argument ") if missing == message else f"{missing} is missing{first}"
        raise InputError(f"{words}; see: {self.prog} --help")

    def refuse_unknown(self, words: list[str]) -> NoReturn:
        """Reject words that no option or argument accepts; the message suggests similar options."""
        option = words[0].partition("=")[0]
        known = self.options
        if option in known:
            self.error(f"{option} stands before the command, expected after it")
        if option.startswith("-"):
            raise UnknownNameError("option", option, (name for name in known if name.startswith("--")))
        self.error(f"unexpected argument {words[0]!r}")

    def needs(self, option: str, *others: str) -> None:
        """Declare that an option has no effect without one of the others."""

        def rule(options: argparse.Namespace) -> str | None:
            if option not in options.given or not options.given.isdisjoint(others):
                return None
            return f"{option} has no effect without {' or '.join(others)}"

        self._rules.append(rule)

    def excludes(self, option: str, *others: str, unless: Iterable[str] = ()) -> None:
        """Declare that the others have no effect together with an option, unless one of `unless` is given too."""

        def rule(options: argparse.Namespace) -> str | None:
            idle = [other for other in others if other in options.given and options.given.isdisjoint(unless)]
            return f"{idle[0]} has no effect with {option}" if idle and option in options.given else None

        self._rules.append(rule)

    def at_most_one(self, *choices: str) -> None:
        """Declare options that exclude each other."""

        def rule(options: argparse.Namespace) -> str | None:
            given = [choice for choice in choices if choice in options.given]
            return f"got {' and '.join(given)}, expected one of {', '.join(choices)}" if len(given) > 1 else None

        self._rules.append(rule)

    def different_files(self, sources: Iterable[str], *outputs: str) -> None:
        """Declare options that name output files: all different, and none of them an input file."""

        def rule(options: argparse.Namespace) -> str | None:
            read = ((source, getattr(options, _attribute(source))) for source in sources)
            files = {
                resolved_path(name): source if source.startswith("-") else source.upper()
                for source, name in read
                if name is not None and os.path.isfile(name)  # noqa: PTH113
            }
            for option in outputs:
                if option in options.given:
                    name = getattr(options, _attribute(option))
                    other = files.setdefault(resolved_path(name), option)
                    if other != option:
                        return f"{other} and {option} are the same file {name!r}"
            return None

        self._rules.append(rule)

    def check(self, options: argparse.Namespace) -> None:
        """Reject options that have no effect together with the others.

        Raises:
            InputError: names the first of them.
        """
        for rule in self._rules:
            message = rule(options)
            if message is not None:
                self.error(message)


def parse(parser: Parser, commands: Mapping[str, Parser], words: Iterable[str]) -> argparse.Namespace:
    """The options of a command line, checked.

    Args:
        parser: The parser of all commands.
        commands: The parser of each.
        words: The words of the command line.

    Raises:
        InputError: an unknown word, a missing one, or an option that has no effect.
        Shown: a text was requested.
    """
    words = [f" {word}" if _NEGATIVE.match(word) else word for word in words]
    command = next((word for word in words if not word.startswith("-")), None)
    if command is not None and command not in commands:
        raise UnknownNameError("command", command, commands)
    options, unknown = parser.parse_known_args(words, argparse.Namespace(given=frozenset()))
    own = commands[str(command)]
    if unknown:
        own.refuse_unknown(unknown)
    own.check(options)
    return options


def spell_options(text: str, command: str, commands: Mapping[str, Parser]) -> str:
    """A message that names "option jerk_limits" in the words of the command line: --jerk-limits.

    Args:
        text: The message.
        command: The running command; an option that only another command has is named with that command.
        commands: The parser of each.
    """

    def spell(found: re.Match[str]) -> str:
        option = "--" + found[1].replace("_", "-")
        for name in (command, *commands):
            if option in commands[name].options:
                return option if name == command else f"{option} of {commands[name].prog}"
        return found[0]

    return re.sub(r"\boption (\w+)", spell, text)


def _attribute(option: str) -> str:
    """The attribute of a namespace with the value of an option or argument."""
    return option.lstrip("-").replace("-", "_")


def _note(action: argparse.Action, namespace: argparse.Namespace, option: str | None) -> None:
    """Record that an option was given; giving it twice is an error, because the first would have no effect."""
    given: frozenset[str] = getattr(namespace, "given", frozenset())
    if option is not None and option in given:
        raise argparse.ArgumentError(action, "given twice, expected once")
    namespace.given = given if option is None else given | {option}


class _Store(argparse.Action):
    """Store the value of an option."""

    def __call__(
        self, _: object, namespace: argparse.Namespace, values: object, option_string: str | None = None
    ) -> None:
        _note(self, namespace, option_string)
        setattr(namespace, self.dest, values)


class _Flag(argparse.Action):
    """Store that an option was given."""

    def __init__(self, option_strings: list[str], dest: str, help: str | None = None) -> None:
        super().__init__(option_strings, dest, nargs=0, default=False, help=help)

    def __call__(
        self, _: object, namespace: argparse.Namespace, values: object, option_string: str | None = None
    ) -> None:
        _note(self, namespace, option_string)
        setattr(namespace, self.dest, True)


class Show(argparse.Action):
    """Print a text and end."""

    def __init__(self, option_strings: list[str], dest: str, text: Callable[[], str], help: str | None = None) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, help=help)
        self._text = text

    def __call__(self, *_: Any) -> NoReturn:
        """Leave the parser."""
        raise Shown(self._text())
