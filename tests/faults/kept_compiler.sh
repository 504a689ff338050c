#!/bin/sh
# Compiles like the compiler in $KEPT_COMPILER, and keeps in $KEPT_LIBRARIES what it made of which files and options:
# a command that starts hundreds of times with an empty cache meets every operation each time, without the waiting.
# Called as ccm_opt calls a compiler: options, the source, -o, the library, -lm.
set -e
source="" output="" options="" next=""
for argument in "$@"; do
    case "$next$argument" in
        output*) output=$argument; next="" ;;
        -o) next="output" ;;
        *.c) source=$argument ;;
        *) options="$options $argument" ;;
    esac
done
[ -n "$source" ] || exec "$KEPT_COMPILER" "$@"
key=$( (echo "$options"; cat "$(dirname "$source")"/*.[ch]) | sha256sum | cut -c1-32)
kept=$KEPT_LIBRARIES/$key
if [ ! -f "$kept" ]; then
    "$KEPT_COMPILER" "$@"
    cp "$output" "$kept.$$"
    mv "$kept.$$" "$kept"
fi
cp "$kept" "$output"
