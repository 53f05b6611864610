# Packages of Debian and of Python that the suites in shell need, to be sourced from them.

packages() { # WHAT PACKAGE...: installs what is missing when this is root, and else says what to install
  local what=$1
  shift
  [ "$(id -u)" -eq 0 ] || {
    echo "$what is missing: install the Debian packages $*" >&2
    return 1
  }
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# What is missing on this machine, as names of Debian packages.
missing_vulkan() { # a driver of a GPU, or else lavapipe
  compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null ||
    echo mesa-vulkan-drivers libvulkan1
}
missing_python() {
  python3 -c "import ensurepip, venv" 2>/dev/null || echo python3 python3-venv
}
missing_emulators() { # with the binutils, and Node for web pages
  command -v qemu-system-arm >/dev/null || echo qemu-system-arm
  command -v qemu-system-riscv32 >/dev/null || echo qemu-system-misc
  command -v arm-none-eabi-objdump >/dev/null || echo binutils-arm-none-eabi
  command -v gcc >/dev/null || echo gcc libc6-dev
  command -v g++ >/dev/null || echo g++
  command -v arm-none-eabi-gcc >/dev/null || echo gcc-arm-none-eabi libnewlib-arm-none-eabi
  command -v python3 >/dev/null || echo python3
  command -v node >/dev/null || echo nodejs
}
missing_screen() { # a virtual one
  command -v Xvfb >/dev/null && command -v xdotool >/dev/null ||
    echo xvfb xdotool libx11-xcb1 libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2
}
missing_browser() { # Chromium, or Chrome
  command -v chromium >/dev/null || command -v google-chrome >/dev/null || echo chromium
}
missing_mpi() { # with libclang, which reads its header
  command -v mpirun >/dev/null && command -v mpicc >/dev/null &&
    compgen -G '/usr/lib/llvm-*/lib/libclang*.so*' >/dev/null || echo libopenmpi-dev openmpi-bin libclang-dev
}

need() { # WHAT KIND...: installs what is missing of these kinds
  local what=$1 kind missing
  shift
  missing=$(for kind; do "missing_$kind"; done)
  # shellcheck disable=SC2086  # one word per package
  [ -z "$missing" ] || packages "$what" $missing
}

python_environment() { # FOLDER REQUIREMENTS: with all of a list, which is complete, and nothing else
  local folder=$1 requirements=$2
  cmp -s "$requirements" "$folder/requirements.txt" && "$folder/bin/python" -c "" && return
  rm -rf "$folder"
  need "Python with its venv module" python && python3 -m venv "$folder" || return 1
  "$folder/bin/python" -m pip install -q --disable-pip-version-check --no-deps -r "$requirements" || return 1
  cp "$requirements" "$folder/requirements.txt"
}
