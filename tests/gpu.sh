#!/usr/bin/env bash
# The GPU's renderer beside the processor's, on a GPU or else on lavapipe, and what the program says where there is none.
#
#   tests/gpu.sh
#
# Installs mesa-vulkan-drivers where no Vulkan driver is found and this is root. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh

drivers=(/usr/share/vulkan/icd.d /etc/vulkan/icd.d)
if ! compgen -G "${drivers[0]}/*.json" >/dev/null && ! compgen -G "${drivers[1]}/*.json" >/dev/null; then
  [ "$(id -u)" -eq 0 ] || {
    echo "Vulkan is missing: install a GPU's driver or mesa-vulkan-drivers"
    exit 1
  }
  apt-get update -q && apt-get install -q -y --no-install-recommends mesa-vulkan-drivers libvulkan1 || exit 1
fi
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-$place}
cargo build -q -p kestrel-train || exit 1
cp target/debug/kestrel target/kestrel-without-gpu
cargo build -q -p kestrel-train --features gpu || exit 1
cp target/debug/kestrel target/kestrel-with-gpu

render() { # PROGRAM BACKEND PICTURE
  "$1" render configs/aviaries/room-0.yaml --columns 64 --rows 48 --output "$place/$3" --backend "$2"
}
says() { # STATUS WORDS COMMAND...: ends with this status, and says this without a panic
  local status=$1 words=$2
  shift 2
  "$@" >"$place/said" 2>&1
  [ $? -eq "$status" ] && grep -q "$words" "$place/said" && ! grep -q panicked "$place/said"
}
without_driver() { # COMMAND...
  VK_ICD_FILENAMES=/nonexistent VK_DRIVER_FILES=/nonexistent "$@"
}

check "lints" cargo clippy -q -p kestrel-sim -p kestrel-train --all-targets --features kestrel-train/gpu -- -D warnings
check "the renderer's tests" cargo test -q -p kestrel-sim --features gpu --lib -- gpu
check "auto renders" says 0 "rendered by the" render target/kestrel-with-gpu auto auto.png
check "the processor renders when asked" says 0 "by the processor: it was asked for" render target/kestrel-with-gpu cpu cpu.png
check "auto without a driver is the processor" \
  says 0 "by the processor: found no GPU" without_driver render target/kestrel-with-gpu auto none.png
check "its picture is the same" cmp "$place/cpu.png" "$place/none.png"
for backend in gpu software; do
  check "$backend without a driver is refused" \
    says 2 "(no driver at all)" without_driver render target/kestrel-with-gpu "$backend" no.png
  check "$backend without the feature is refused" \
    says 2 "was built without GPUs" render target/kestrel-without-gpu "$backend" no.png
done
check "auto without the feature is the processor" \
  says 0 "by the processor: this program was built without GPUs" render target/kestrel-without-gpu auto other.png
check "an unknown backend is refused" says 2 "found \`cuda\`" render target/kestrel-with-gpu cuda no.png

summary
