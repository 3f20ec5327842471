"""The completion scripts for three shells, made from what the commands' own parsers take."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Option:
    """An option: its spellings, one line of help, the words that may follow it, and whether a value must follow."""

    words: tuple[str, ...]
    help: str
    choices: tuple[str, ...] = ()
    takes: bool = False


@dataclass(slots=True)
class Command:
    """A command: its line of help, its options, the words that its arguments may be, and its sub-commands."""

    name: str
    help: str
    options: list[Option] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    inner: dict[str, Command] = field(default_factory=dict)


#: Options of every command.
COMMON = [
    Option(("-h", "--help"), "show the help"),
    Option(("-q", "--quiet"), "results and errors only"),
    Option(("-v", "--verbose"), "also what took how long"),
    Option(("--color",), "when to use colours", ("auto", "always", "never"), takes=True),
]

Commands = dict[str, Command]

_BASH = """\
# Completion of itouch-py for bash; made by `itouch-py completion bash`.
_itouch_py() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} path="" word index words="" files=yes
  for ((index = 1; index < COMP_CWORD; index++)); do
    word=${{COMP_WORDS[index]}}
    case "$path/$word" in
{paths}
    esac
  done
  case "$path $before" in
{values}
  esac
  if [[ -n $words ]]; then
    files=  # the option takes one of these words, and no file
  else
    case "$path" in
{options}
    esac
    if [[ $current != -* ]]; then
      case "$path" in
{places}
      esac
    fi
  fi
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  if [[ -n $files && $current != -* ]]; then
    local file
    while IFS= read -r file; do COMPREPLY+=("$file"); done < <(compgen -f -- "$current")
  fi
}}
complete -o filenames -o bashdefault -F _itouch_py itouch-py
"""


def all_of(found: dict[str, Command]) -> Iterator[tuple[tuple[str, ...], Command]]:
    """Yield each command and sub-command with the words that lead to it."""
    for name, command in found.items():
        yield (name,), command
        for inner, sub in command.inner.items():
            yield (name, inner), sub


def bash(found: Commands) -> str:
    """Return the script for bash."""
    paths, values, options, places = [], [], [], []
    for way, command in all_of(found):
        place = "/".join(("", *way))
        paths.append(f"      {place}) path={place} ;;")
        options.append(f'      {place}) words="{_words(command.options)}" ;;')
        own = [*command.inner, *command.words]
        if own:
            # what follows the word of a bench may be a file
            places.append(f'      {place}) words="{" ".join(own)}"; [[ $before != {way[-1]} ]] || files= ;;')
        values += [
            f'    "{place} {word}") words="{" ".join(option.choices)}" ;;'
            for option in command.options if option.choices for word in option.words
        ]  # fmt: skip
    values.append('    *" --color") words="auto always never" ;;')
    run = _words(found["run"].options) if "run" in found else ""
    options.append(f'      *) words="--version {run} {_words([])}" ;;')
    places.append(f'      "") words="{" ".join(found)}" ;;')
    return _BASH.format(paths=_lines(paths), values=_lines(values), options=_lines(options), places=_lines(places))


def zsh(found: Commands) -> str:
    """Return the script for zsh."""
    lines = ["#compdef itouch-py", "# Completion of itouch-py for zsh; made by `itouch-py completion zsh`.",
             "_itouch_py() {", "  local context state line", "  typeset -A opt_args", "  local -a commands",
             "  commands=("]  # fmt: skip
    lines += [f"    {_quoted(f'{_zsh(name)}:{command.help}')}" for name, command in found.items()]
    lines += ["  )", "  if (( CURRENT == 2 )); then", "    _describe -t commands command commands",
              "    _files -g '*.(xml|itouch)'", "    return", "  fi", '  case "$words[2]" in']  # fmt: skip
    for name, command in found.items():
        lines.append(f"    {name})")
        if command.inner:
            lines.append('      case "$words[3]" in')
            for inner, sub in command.inner.items():
                lines += [f"        {inner}) _arguments {_zsh_arguments(sub)} ;;"]
            lines += [f"        *) _values {_quoted(name)} {' '.join(map(_quoted, command.inner))} ;;", "      esac"]
        else:
            lines.append(f"      _arguments {_zsh_arguments(command)}")
        lines.append("      ;;")
    run = _zsh_arguments(found["run"]) if "run" in found else ""
    lines += [f"    *) _arguments {run} ;;", "  esac", "}"]  # fmt: skip
    lines += ['if [ "$funcstack[1]" = "_itouch_py" ]; then _itouch_py "$@"; else compdef _itouch_py itouch-py; fi']
    return _lines(lines) + "\n"


def fish(found: Commands) -> str:
    """Return the script for fish."""
    begin = "complete -c itouch-py"
    lines = ["# Completion of itouch-py for fish; made by `itouch-py completion fish`."]
    lines += [f"{begin} {_fish(option)}" for option in COMMON]
    for name, command in found.items():
        lines.append(f"{begin} -n __fish_use_subcommand -a {name} -d {_quoted(command.help)}")
        seen = f"__fish_seen_subcommand_from {name}"
        lines += [f"{begin} -n {_quoted(seen)} -a {word}" for word in command.words]
        lines += [f"{begin} -n {_quoted(seen)} -a {inner} -d {_quoted(sub.help)}"
                  for inner, sub in command.inner.items()]  # fmt: skip
        for option in command.options:
            lines.append(f"{begin} -n {_quoted(seen)} {_fish(option)}")
        for inner, sub in command.inner.items():
            both = f"{seen}; and __fish_seen_subcommand_from {inner}"
            lines += [f"{begin} -n {_quoted(both)} {_fish(option)}" for option in sub.options]
    return _lines(lines) + "\n"


def _fish(option: Option) -> str:
    words = [f"-l {word[2:]}" if word.startswith("--") else f"-s {word[1:]}" for word in option.words]
    if option.choices:
        words.append(f"-x -a {_quoted(' '.join(option.choices))}")
    elif option.takes:
        words.append("-r")
    return " ".join([*words, f"-d {_quoted(option.help)}"])


def _zsh_arguments(command: Command) -> str:
    parts = []
    for option in (*COMMON, *command.options):
        value = ""
        if option.choices:
            value = f":value:({' '.join(option.choices)})"
        elif option.takes:
            value = ":value:_files"
        said = option.help.replace("[", "(").replace("]", ")").replace(":", "\\:")
        parts += [_quoted(f"{word}[{said}]{value}") for word in option.words]
    rest = f"*:word:({' '.join(command.words)})" if command.words else "*:file:_files"
    return " ".join([*parts, _quoted(rest)])


def _zsh(text: str) -> str:
    return text.replace(":", "\\:")


def _words(options: list[Option]) -> str:
    return " ".join(word for option in (*options, *COMMON) for word in option.words)


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


def _lines(lines: list[str]) -> str:
    return "\n".join(lines)


WRITERS: dict[str, Callable[[Commands], str]] = {"bash": bash, "zsh": zsh, "fish": fish}
