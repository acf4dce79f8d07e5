# Completion of 'harness' in fish:  harness completion fish | source
function __harness_answer
    set -l command (string replace -r '^~' $HOME -- (commandline -opc)[1])
    set -l answer ($command completion --query (commandline -cp) 2>/dev/null)
    if test "$answer" = :files
        __fish_complete_path (commandline -ct)
    else
        printf '%s\n' $answer
    end
end
complete -c harness -f -a '(__harness_answer)'
