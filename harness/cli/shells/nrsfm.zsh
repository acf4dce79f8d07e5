#compdef nrsfm
# Completion of 'nrsfm' in zsh:  eval "$(nrsfm completion zsh)", or this text in a file _nrsfm of the fpath
_nrsfm() {
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
    _describe -t words 'nrsfm' open -Q -S '' -- done -Q
}
if [[ $funcstack[1] == _nrsfm ]]; then
    _nrsfm "$@"
else
    (( $+functions[compdef] )) || { autoload -Uz compinit && compinit }
    compdef _nrsfm nrsfm
fi
