# Debian packages that the suites in shell need, to be sourced from them.

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
