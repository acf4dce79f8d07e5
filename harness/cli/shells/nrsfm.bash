# Completion of 'nrsfm' in bash:  eval "$(nrsfm completion bash)"
_nrsfm() {
    local command=${1/#\~/$HOME} line=${COMP_LINE:0:COMP_POINT} answer word replaced=
    answer=$("$command" completion --query "$line" 2>/dev/null) || return
    COMPREPLY=()
    if [[ $answer == :files ]]; then
        compopt -o filenames +o nospace 2>/dev/null
        while IFS= read -r word; do COMPREPLY+=("$word"); done < <(compgen -f -- "$2")
        return
    fi
    # readline replaces what stands behind the last of its word breaks, such as = and :
    word=${line##*[[:space:]]}
    if [[ $word == *[=:]* && $COMP_WORDBREAKS == *=* ]]; then
        replaced=${word%"${word##*[=:]}"}
    fi
    while IFS= read -r word; do
        word=${word%%$'\t'*}
        word=${word#"$replaced"}
        case $word in
            '') ;;
            *[=./]) COMPREPLY+=("$word") ;;
            *) COMPREPLY+=("$word ") ;;
        esac
    done <<< "$answer"
}
complete -o nospace -F _nrsfm nrsfm
