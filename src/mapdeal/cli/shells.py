"""Scripts for shells, made of the words of the command line.

All words stand in the script: no process is started while somebody types.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from mapdeal.cli.words import CommandWords, OptionWords, Value, every_command

_BASH = r"""# Completes the words of mapdeal in bash; made by: mapdeal completion bash
_mapdeal_files() {
    local file ending
    compopt -o filenames 2>/dev/null
    while IFS= read -r file; do
        if [[ -d ${file/#\~/$HOME} ]]; then
            COMPREPLY+=("$file")
            continue
        fi
        for ending in $1; do
            if [[ $file == *"${ending#any}" ]]; then
                COMPREPLY+=("$file")
                break
            fi
        done
    done < <(compgen -f -- "$cur")
}

_mapdeal() {
    local cur prev word count=0 i command="" options="" values="" files="" below=""
    local -a typed=()
    COMPREPLY=()
    for ((i = 1; i <= COMP_CWORD; i++)); do  # bash has split words at = and :
        word=${COMP_WORDS[i]}
        if ((count)) && [[ $word == [=:]* || ${typed[count - 1]} == *[=:] ]]; then
            typed[count - 1]+=$word
        else
            typed[count]=$word
            count=$((count + 1))
        fi
    done
    cur=${typed[count - 1]}
    prev=""
    ((count > 1)) && prev=${typed[count - 2]}
    if [[ $cur == --*=* ]]; then
        prev=${cur%%=*}
        cur=${cur#*=}
    fi
    for ((i = 0; i < count - 1; i++)); do
        word=${typed[i]}
        if [[ -z $command && $word != -* ]]; then
            command=$word
        elif [[ $command == @GROUPS@ && $word != -* ]]; then
            command="$command $word"
            break
        fi
    done
    case "$command" in
@COMMANDS@
    esac
    case "$command $prev" in
@VALUES@
        *) values="-" ;;
    esac
    if [[ $values == "-" ]]; then
        values=$below
        if [[ $cur == -* ]]; then
            values=$options
            files=""
        fi
    else
        files=""
        case "$command $prev" in
@FILES@
        esac
    fi
    local IFS=$' \t\n' list=""
    if [[ ($prev == --select || $prev == --ignore) && $cur == *,* ]]; then
        list=${cur%,*},
        cur=${cur##*,}
    fi
    COMPREPLY=($(compgen -P "$list" -W "$values" -- "$cur"))
    if [[ $files == "/" ]]; then
        compopt -o filenames 2>/dev/null
        COMPREPLY+=($(compgen -d -- "$cur"))
    elif [[ -n $files ]]; then
        _mapdeal_files "$files"
    fi
    if [[ $cur == *=* && $COMP_WORDBREAKS == *=* ]]; then
        COMPREPLY=("${COMPREPLY[@]#"${cur%"${cur##*=}"}"}")
    fi
    if [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *= ]]; then
        compopt -o nospace 2>/dev/null
    fi
    return 0
}
complete -F _mapdeal mapdeal"""


def bash_script(root: CommandWords) -> str:
    """Return the script for bash 3.2 and newer."""
    commands, values, files = [], {}, {}
    named = [((), root), *every_command(root)]
    for names, one in named:
        options = " ".join(name for option in one.options for name in option.names)
        below = " ".join(each.name for each in one.commands)
        argument = one.argument
        parts = [f'options="{options}"', f'below="{below}"']
        if argument is not None:
            parts[1] = f'below="{" ".join(argument.words)}"'
            parts.append(f'files="{_bash_files(argument)}"')
        commands.append(f'        "{" ".join(names)}") {" ".join(parts)} ;;')
        for option in one.options:
            if option.value is not None:
                pattern = "|".join(f'"{" ".join((*names, name))}"' for name in option.names)
                values[pattern] = " ".join(option.value.words)
                files[pattern] = _bash_files(option.value)
    groups = "|".join(one.name for one in root.commands if one.commands) or "-"
    texts = {
        "@GROUPS@": f"@({groups})" if "|" in groups else groups,
        "@COMMANDS@": "\n".join(commands),
        "@VALUES@": _bash_cases(values, "values"),
        "@FILES@": _bash_cases({key: text for key, text in files.items() if text}, "files"),
    }
    script = _BASH
    for mark, text in texts.items():
        script = script.replace(mark, text)
    return script


def _bash_cases(texts: dict[str, str], name: str) -> str:
    """Return a branch for each text, with all patterns that have it."""
    by_text: dict[str, list[str]] = {}
    for pattern, text in texts.items():
        by_text.setdefault(text, []).append(pattern)
    return "\n".join(
        f'        {"|".join(patterns)}) {name}="{text}" ;;' for text, patterns in by_text.items()
    )


def _bash_files(value: Value) -> str:
    if value.is_folder:
        return "/"
    if value.endings is None:
        return ""
    return " ".join(value.endings) or "any"


def zsh_script(root: CommandWords) -> str:
    """Return the script for zsh."""
    lines = ["#compdef mapdeal", "# made by: mapdeal completion zsh"]
    lines += _zsh_functions("_mapdeal", root)
    lines += [
        'if [ "$funcstack[1]" = "_mapdeal" ]; then',
        '    _mapdeal "$@"',
        "else",
        "    compdef _mapdeal mapdeal",
        "fi",
    ]
    return "\n".join(lines)


def _zsh_functions(name: str, command: CommandWords) -> Iterator[str]:
    """Yield the lines of the function of a command, those below it first."""
    for one in command.commands:
        yield from _zsh_functions(f"{name}_{_plain(one.name)}", one)
    specs = [spec for option in command.options for spec in _zsh_option(option)]
    yield f"{name}() {{"
    if not command.commands:
        if command.argument is not None:
            specs.append(f"*:{_zsh_value(command.argument)}")
        yield "    _arguments -s -S \\"
        yield " \\\n".join(f"        {_zsh_quoted(spec)}" for spec in specs)
        yield "}"
        return
    yield "    local curcontext=$curcontext state line"
    yield "    typeset -A opt_args"
    yield "    _arguments -C \\"
    yield "".join(f"        {_zsh_quoted(spec)} \\\n" for spec in specs).rstrip("\n")
    yield "        '1: :->command' '*:: :->rest'"
    yield "    case $state in"
    yield "        command)"
    yield "            local -a commands=("
    for one in command.commands:
        meaning = one.meaning.replace(":", r"\:")
        yield f"                {_zsh_quoted(f'{one.name}:{meaning}')}"
    yield "            )"
    yield "            _describe command commands ;;"
    yield "        rest)"
    yield "            case $line[1] in"
    for one in command.commands:
        yield f"                {one.name}) {name}_{_plain(one.name)} ;;"
    yield "            esac ;;"
    yield "    esac"
    yield "}"


def _zsh_option(option: OptionWords) -> Iterator[str]:
    meaning = re.sub(r"([\[\]:\\])", r"\\\1", option.meaning)
    for name in option.names:
        if option.value is None:
            yield f"*{name}[{meaning}]"
        else:
            mark = "=" if name.startswith("--") else "+"
            yield f"*{name}{mark}[{meaning}]:{_zsh_value(option.value)}"


def _zsh_value(value: Value) -> str:
    """Return what a value is called, and the action that completes it."""
    if value.is_folder:
        return "folder:_files -/"
    files = ""
    if value.endings is not None:
        pattern = "|".join(ending.removeprefix(".") for ending in value.endings)
        files = f'_files -g "*.({pattern})(-.)"' if pattern else "_files"
    words = " ".join(value.words)
    if words and files:
        return f"value:{{compadd -- {words}; {files}}}"
    if any(word.endswith("=") for word in value.words):
        return f"value:{{compadd -S '' -- {words}}}"
    if words:
        return f"value:({words})"
    return f"file:{files}" if files else "value: "


def fish_script(root: CommandWords) -> str:
    """Return the script for fish."""
    lines = [
        "# made by: mapdeal completion fish",
        "function __mapdeal_is",
        "    set -l words (commandline -opc)[2..]",
        "    set words (string match -v -- '-*' $words)",
        "    for i in (seq (count $argv))",
        '        test "$words[$i]" = "$argv[$i]"; or return 1',
        "    end",
        "end",
        "function __mapdeal_needs",
        "    __mapdeal_is $argv; or return 1",
        "    set -l words (commandline -opc)[2..]",
        "    test (count (string match -v -- '-*' $words)) -eq (count $argv)",
        "end",
        "function __mapdeal_files",
        "    set -l token (string replace -r -- '^--[^=]*=' '' (commandline -ct))",
        "    set token (string replace -r -- '^~/' $HOME/ $token)",
        "    for file in $token*",
        '        if test -d "$file"',
        '            echo "$file/"',
        "        else",
        "            for ending in $argv",
        '                string match -q -- "*$ending" "$file"; and echo "$file"; and break',
        "            end",
        "        end",
        "    end",
        "end",
        "complete -c mapdeal -f",
    ]
    for names, one in [((), root), *every_command(root)]:
        path = " ".join(names)
        for below in one.commands:
            meaning = _fish_quoted(below.meaning)
            lines.append(
                f"complete -c mapdeal -n '__mapdeal_needs {path}' -a {below.name} -d {meaning}"
            )
        condition = f"complete -c mapdeal -n '__mapdeal_is {path}'"
        if not names:
            condition = "complete -c mapdeal -n '__mapdeal_needs'"
        lines += [f"{condition} {_fish_option(option)}" for option in one.options]
        if one.argument is not None:
            lines.append(f"{condition} {_fish_value(one.argument)}".rstrip())
    return "\n".join(lines)


def _fish_option(option: OptionWords) -> str:
    words = [f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in option.names]
    text = f"{' '.join(words)} -d {_fish_quoted(option.meaning)}"
    return text if option.value is None else f"{text} -x {_fish_value(option.value)}".rstrip()


def _fish_value(value: Value) -> str:
    words = " ".join(value.words)
    if value.is_folder:
        return "-a '(__fish_complete_directories)'"
    if value.endings is None:
        return f"-a {_fish_quoted(words)}" if words else ""
    suffixes = " ".join(value.endings) or '""'
    files = f"(__mapdeal_files {suffixes})"
    return f"-a {_fish_quoted(f'{words} {files}'.strip())}"


def _plain(name: str) -> str:
    return name.replace("-", "_")


def _zsh_quoted(text: str) -> str:
    """Return a text as one word of zsh."""
    return "'" + text.replace("'", "'\\''") + "'"


def _fish_quoted(text: str) -> str:
    """Return a text as one word of fish, where a backslash escapes within quotes, too."""
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


SHELLS: dict[str, Callable[[CommandWords], str]] = {
    "bash": bash_script, "zsh": zsh_script, "fish": fish_script,
}  # fmt: skip
"""What makes the script of each shell."""
