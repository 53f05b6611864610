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

vulkan_driver() { # of a GPU, or else lavapipe
  compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null ||
    packages "a Vulkan driver" mesa-vulkan-drivers libvulkan1
}

python_environment() { # FOLDER REQUIREMENTS: with all of a list, which is complete, and nothing else
  local folder=$1 requirements=$2
  cmp -s "$requirements" "$folder/requirements.txt" && "$folder/bin/python" -c "" && return
  rm -rf "$folder"
  if ! python3 -m venv "$folder"; then
    packages "Python with its venv module" python3 python3-venv || return 1
    rm -rf "$folder"
    python3 -m venv "$folder" || return 1
  fi
  "$folder/bin/python" -m pip install -q --disable-pip-version-check --no-deps -r "$requirements" || return 1
  cp "$requirements" "$folder/requirements.txt"
}
