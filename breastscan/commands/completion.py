"""`breastscan --completion`: what bash and zsh complete, commands, options and settings by name."""

from collections.abc import Iterable
from importlib import import_module

from breastscan.commands.settings import Setting, settings_of

SCRIPT = """\
# breastscan's completion, for bash and zsh: source <(breastscan --completion)
[ -n "$ZSH_VERSION" ] && autoload -U +X bashcompinit && bashcompinit
_breastscan() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} words
  case ${{COMP_CWORD}}:${{COMP_WORDS[1]}} in
    1:*) words="{commands}" ;;
{cases}
  esac
  COMPREPLY=($(compgen -W "$words" -- "$word"))
  [[ ${{COMPREPLY[0]}} == *= ]] && compopt -o nospace 2>/dev/null
  return 0
}}
complete -o default -F _breastscan breastscan
"""
COMMON = ("--help", "--help-all", "--set", "--config")
"""Options that every command has."""


def script(commands: Iterable[str]) -> str:
    """The script for a shell, with every name of today's commands in it."""
    names = list(commands)
    cases = [f'    *:{name}) words="{" ".join(_words(name))}" ;;' for name in names]
    return SCRIPT.format(commands=" ".join(names), cases="\n".join(cases))


def _words(name: str) -> list[str]:
    """The options of a command; a setting below one is written as `--set` takes it, too."""
    known = settings_of(getattr(import_module(f"breastscan.commands.{name}"), name))
    nested = [f"{path}=" for path in known if "." in path]
    return [*COMMON, *(option for path in known for option in _options(path, known[path])), *nested]


def _options(path: str, setting: Setting) -> list[str]:
    option = f"--{path.replace('_', '-')}"
    negated = "--no-" + option[2:]
    return [option, negated] if setting.kind is bool and "." not in path else [option]
