# Completion of 'nrsfm' in fish:  nrsfm completion fish | source
function __nrsfm_answer
    set -l command (string replace -r '^~' $HOME -- (commandline -opc)[1])
    set -l answer ($command completion --query (commandline -cp) 2>/dev/null)
    if test "$answer" = :files
        __fish_complete_path (commandline -ct)
    else
        printf '%s\n' $answer
    end
end
complete -c nrsfm -f -a '(__nrsfm_answer)'
