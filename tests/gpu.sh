#!/usr/bin/env bash
# What the program says of GPUs, with one (or with lavapipe) and where there is none.
#
#   tests/gpu.sh
#
# Installs mesa-vulkan-drivers where no Vulkan driver is found and this is root. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/packages.sh
. tests/packages.sh
# shellcheck source=tests/programs.sh
. tests/programs.sh

need "a Vulkan driver" vulkan || exit 1
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-$place}
program_without_gpus 2>"$place/built" || { cat "$place/built" && exit 1; }

render() { # PROGRAM BACKEND PICTURE
  "$1" render configs/aviaries/room-0.yaml --columns 64 --rows 48 --output "$place/$3" --backend "$2"
}
says() { # STATUS WORDS COMMAND...: ends with this status, and says this without a panic
  local status=$1 words=$2
  shift 2
  "$@" >"$place/said" 2>&1
  [ $? -eq "$status" ] && grep -q "$words" "$place/said" && ! grep -q panicked "$place/said"
}
says_nothing_of() { # WORD FILE
  ! grep -A5 "$1" "$2"
}
without_driver() { # COMMAND...
  VK_ICD_FILENAMES=/nonexistent VK_DRIVER_FILES=/nonexistent "$@"
}

# The lints of tests/run know the code with its features alone.
check "without GPUs nothing is unused" says_nothing_of warning "$place/built"
check "auto renders" says 0 "rendered by the" render target/debug/kestrel auto auto.png
check "the processor renders when asked" says 0 "by the processor: it was asked for" render target/debug/kestrel cpu cpu.png
check "auto without a driver is the processor" \
  says 0 "by the processor: found no GPU" without_driver render target/debug/kestrel auto none.png
check "its picture is the same" cmp "$place/cpu.png" "$place/none.png"
for backend in gpu software; do
  check "$backend without a driver is refused" \
    says 2 "(no driver at all)" without_driver render target/debug/kestrel "$backend" no.png
  check "$backend without the feature is refused" \
    says 2 "without GPUs.*build it with .--features gpu., or ask for the backend .cpu." \
    render target/kestrel-without-gpus "$backend" no.png
done
check "auto without the feature is the processor" \
  says 0 "by the processor: this program was built without GPUs" render target/kestrel-without-gpus auto other.png
check "an unknown backend is refused" says 2 "found \`cuda\`" render target/debug/kestrel cuda no.png

summary
