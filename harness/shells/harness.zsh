#compdef harness
# Completion of 'harness' in zsh:  eval "$(harness completion zsh)", or this text in a file _harness of the fpath
_harness() {
    local line word text
    local -a answer open done
    answer=("${(@f)$("${words[1]/#\~/$HOME}" completion --query "${(j: :)words[1,CURRENT-1]} $PREFIX" 2>/dev/null)}")
    if [[ $answer[1] == :files ]]; then
        _files
        return
    fi
    for line in $answer; do
        word=${${line%%$'\t'*}//:/\\:}
        text=${${line#*$'\t'}}
        [[ $text != $line ]] && word+=:$text
        case ${line%%$'\t'*} in
            *[=./]) open+=("$word") ;;
            *) done+=("$word") ;;
        esac
    done
    _describe -t words 'harness' open -Q -S '' -- done -Q
}
if [[ $funcstack[1] == _harness ]]; then
    _harness "$@"
else
    (( $+functions[compdef] )) || { autoload -Uz compinit && compinit }
    compdef _harness harness
fi
