"""Completion scripts: shell functions that look words up in the completion table.

They start no program, so that an answer takes milliseconds. Long lists of keys are shown by group:
``optim.`` first, then the keys in it.
"""

from __future__ import annotations

TABLE = "@TABLE@"
"""Place of the table in a script; no line of it has a quote."""

BASH = r"""# gsfw completion for bash. Load it from ~/.bashrc, or save it as
# ~/.local/share/bash-completion/completions/gsfw
if (( BASH_VERSINFO[0] * 100 + BASH_VERSINFO[1] < 403 )); then
    echo "gsfw completion needs bash 4.3, and this is $BASH_VERSION." \
        "Install a newer bash, or use zsh: gsfw completion zsh" >&2
    return 1
fi
declare -gA _gsfw_table=(
@TABLE@
)

_gsfw() {
    local line=${COMP_LINE:0:COMP_POINT} word slot context key values rest found=' ' before=''
    local -a words=() contexts=('-')
    COMPREPLY=()
    # An escaped space is part of its word.
    line=${line//\\ /$'\001'}
    read -ra words <<< "$line"
    [[ $line == *[[:space:]] || ${#words[@]} -lt 2 ]] && words+=('')
    words=("${words[@]//$'\001'/ }")
    local current=${words[-1]//\\/} verb=${words[1]}
    if (( ${#words[@]} > 2 )); then
        before=" ${words[*]:2:${#words[@]}-3} "
        contexts=("$verb")
        for word in "${words[@]:2:${#words[@]}-3}"; do contexts+=("$verb $word"); done
        for slot in method strategy rasterizer datamanager sampler; do
            [[ $before == *" $slot="* ]] || contexts+=("$verb $slot=")
        done
    fi
    for context in "${contexts[@]}"; do
        while IFS='|' read -r key values; do
            if [[ $current == *=* ]]; then
                [[ $key == "${current%%=*}=" ]] && _gsfw_values "${current#*=}" "$values"
            elif [[ $key == @ ]]; then
                _gsfw_files "$current"
            elif [[ -n $key && $key == "$current"* && $before != *" $key"* ]]; then
                rest=${key#"$current"}
                [[ $rest == *.*= ]] && key=$current${rest%%.*}.
                [[ $found == *" $key "* ]] || { found+="$key "; COMPREPLY+=("$key"); }
            fi
        done <<< "${_gsfw_table[$context]}"
    done
    for word in "${COMPREPLY[@]}"; do
        [[ $word == *[=./] ]] && compopt -o nospace 2> /dev/null && break
    done
    # Where "=" does not separate words for readline, an answer has the key too.
    if [[ $current == *=* && $COMP_WORDBREAKS != *=* ]]; then
        COMPREPLY=("${COMPREPLY[@]/#/${current%%=*}=}")
    fi
}

_gsfw_values() {
    # In a list the last item is completed.
    local value item=${1##*,} values
    read -ra values <<< "$2"
    for value in "${values[@]}"; do
        if [[ $value == @ ]]; then
            _gsfw_files "$1"
        elif [[ $value == "$item"* ]]; then
            COMPREPLY+=("${1%"$item"}$value")
        fi
    done
}

_gsfw_files() {
    local path
    if [[ -z $1 && " ${COMPREPLY[*]} " == *' latest '* ]]; then
        [[ -d runs ]] && COMPREPLY+=(runs/)
        return
    fi
    while IFS= read -r path; do
        [[ -d $path ]] && path+=/
        [[ $path == *[!a-zA-Z0-9_./+:@%,~=-]* ]] && printf -v path %q "$path"
        [[ -n $path ]] && COMPREPLY+=("$path")
    done < <(compgen -f -- "$1")
}

complete -F _gsfw gsfw
"""

ZSH = r"""#compdef gsfw
# gsfw completion for zsh. Load it from ~/.zshrc after compinit, or save it as _gsfw in a folder
# of $fpath.
typeset -gA _gsfw_table=(
@TABLE@
)

_gsfw() {
    local current=$PREFIX verb=${words[2]} key values rest slot word context before=''
    local -a open closed chosen contexts=('-')
    local files=0
    if (( CURRENT > 2 )); then
        before=" ${words[3,CURRENT-1]} "
        contexts=("$verb")
        for word in ${words[3,CURRENT-1]}; do contexts+=("$verb $word"); done
        for slot in method strategy rasterizer datamanager sampler; do
            [[ $before == *" $slot="* ]] || contexts+=("$verb $slot=")
        done
    fi
    for context in $contexts; do
        while IFS='|' read -r key values; do
            if [[ $current == *=* ]]; then
                [[ $key == "${current%%=*}=" ]] || continue
                for word in ${=values}; do
                    if [[ $word == @ ]]; then files=1; else chosen+=("$word"); fi
                done
            elif [[ $key == @ ]]; then
                files=1
            elif [[ -n $key && $key == "$current"* && $before != *" $key"* ]]; then
                rest=${key#"$current"}
                [[ $rest == *.*= ]] && key=$current${rest%%.*}.
                if [[ $key == *[=.] ]]; then open+=("$key"); else closed+=("$key"); fi
            fi
        done <<< "${_gsfw_table[$context]}"
    done
    [[ $current == *=* ]] && compset -P '*='
    (( $#chosen && ! files )) && compset -P '*,'  # In a list the last item is completed.
    (( $#chosen )) && compadd -- ${(u)chosen}
    (( $#closed )) && compadd -- ${(u)closed}
    (( $#open )) && compadd -S '' -- ${(u)open}
    (( files )) && _files
    return 0
}

if [[ $funcstack[1] == _gsfw ]]; then _gsfw "$@"; else compdef _gsfw gsfw; fi
"""

FISH = r"""# gsfw completion for fish. Save it as ~/.config/fish/completions/gsfw.fish
set -g __gsfw_table \
@TABLE@

function __gsfw_complete
    set -l words (commandline -opc)
    set -l current (commandline -ct)
    set -l before $words[3..-1]
    set -l contexts -
    if test (count $words) -ge 2
        set contexts $words[2]
        for word in $before
            set -a contexts "$words[2] $word"
        end
        for slot in method strategy rasterizer datamanager sampler
            string match -q -- "$slot=*" $before; or set -a contexts "$words[2] $slot="
        end
    end
    for context in $contexts
        set -l start '^'(string escape --style=regex -- "$context|")
        for line in (string replace -rf -- $start '' $__gsfw_table)
            set -l parts (string split '|' -- $line)
            if string match -q -- '*=*' $current
                __gsfw_values $current $parts
            else if test "$parts[1]" = @
                if test -z "$current"; and contains -- "$context|latest|" $__gsfw_table
                    test -d runs; and echo runs/
                else
                    __fish_complete_path (string unescape -- $current)
                end
            else if __gsfw_begins $parts[1] $current
                string match -q -- "$parts[1]*" $before; and continue
                __gsfw_grouped $current $parts[1]
            end
        end
    end
end

function __gsfw_values --argument-names current key values
    test "$key" = (string replace -r '=.*' '=' -- $current); or return
    # In a list the last item is completed.
    set -l before (string replace -rf '^[^=]*=(.*,)?.*' '$1' -- $current)
    set -l path (string unescape -- (string replace -r '^[^=]*=' '' -- $current))
    for word in (string split -n ' ' -- $values)
        if test $word = @
            printf "$key%s\n" (__fish_complete_path $path)
        else
            echo $key$before$word
        end
    end
end

function __gsfw_begins --argument-names text start
    test (string sub -l (string length -- "$start") -- $text) = "$start"
end

function __gsfw_grouped --argument-names current key
    set -l rest (string sub -s (math (string length -- "$current") + 1) -- $key)
    if string match -q -- '*.*=' $rest
        echo $current(string replace -r '\..*' '.' -- $rest)
    else
        echo $key
    end
end

complete -c gsfw -f -a '(__gsfw_complete | sort -u)'
"""

SCRIPTS = {"bash": BASH, "zsh": ZSH, "fish": FISH}


def completion_script(shell: str, table: list[str]) -> str:
    """The script of a shell, one of ``SCRIPTS``, with a table."""
    lines = [line for line in table if not set("'\\\n") & set(line)]
    if shell == "fish":
        filled = " \\\n".join(f"    '{line}'" for line in lines)
    else:
        groups: dict[str, list[str]] = {}
        for line in lines:
            context, _, rest = line.partition("|")
            groups.setdefault(context, []).append(rest)
        filled = "\n".join(f"['{name}']='{chr(10).join(rest)}'" for name, rest in groups.items())
    return SCRIPTS[shell].replace(TABLE, filled)
