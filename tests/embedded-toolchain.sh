#!/usr/bin/env bash
# Makes Rust build for the Crazyflie's microcontroller, for RISC-V and for web pages, and prints the cargo command
# that does.
#
#   cargo=$(tests/embedded-toolchain.sh) && $cargo build -p kestrel-core --target thumbv7em-none-eabihf
#
# First choice: `rustup target add`. Where the targets of rustup cannot be downloaded: Debian's own compiler and
# library source (bookworm or newer, root), from which the core libraries are built once and linked into rustup as
# the toolchain `kestrel-embedded`. Running it again changes nothing.
# Exit status: 0 ready, 1 failed, 3 neither way is open on this machine.
#
# Environment: KESTREL_EMBEDDED_PREFIX  where the Debian-based toolchain lives (default: the user's cache)
set -euo pipefail

targets="thumbv7em-none-eabihf riscv32imac-unknown-none-elf wasm32-unknown-unknown"
name=kestrel-embedded
prefix=${KESTREL_EMBEDDED_PREFIX:-${XDG_CACHE_HOME:-$HOME/.cache}/kestrel/embedded-toolchain}
rustc=/usr/bin/rustc
cargo=/usr/bin/cargo
library=/usr/lib/rustlib/src/rust/library

say() { echo "embedded-toolchain: $*" >&2; }

has_core() { # COMMAND...: whether this rustc has the core library of every target
  local target directory
  for target in $targets; do
    directory=$("$@" --print target-libdir --target "$target" 2>/dev/null) || return 1
    compgen -G "$directory/libcore-*.rlib" >/dev/null || return 1
  done
}

with_rustup() {
  command -v rustup >/dev/null || return 1
  # shellcheck disable=SC2086  # one word per target
  has_core rustc || timeout 120 rustup target add $targets >&2 || return 1
  has_core rustc
}

version() { "${2:-$rustc}" -vV 2>/dev/null | sed -n "s/^$1: //p"; }

linker() { # path of an LLVM linker: rustup's when there is one, else Debian's
  local bundled
  bundled=$(rustc --print sysroot 2>/dev/null)/lib/rustlib/$(version host rustc)/bin/rust-lld
  if [ -x "$bundled" ]; then echo "$bundled"; else echo /usr/bin/lld-19; fi
}

install_packages() {
  local packages="rustc-web cargo-web rust-web-src"
  [ "$(basename "$(linker)")" = rust-lld ] || packages="$packages lld-19"
  # shellcheck disable=SC2086  # one word per package
  if dpkg --status $packages >/dev/null 2>&1; then return 0; fi
  if [ "$(id -u)" != 0 ]; then say "not root: install the Debian packages $packages first"; return 3; fi
  say "installing Debian packages: $packages"
  apt-get update -qq >&2
  # shellcheck disable=SC2086
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages >/dev/null
}

lay_out() { # a sysroot beside Debian's: its host libraries, a linker, wrappers that select it
  local host
  host=$(version host)
  mkdir -p "$prefix/bin" "$prefix/lib/rustlib/$host/bin"
  ln -sfn /usr/lib/rustlib/src "$prefix/lib/rustlib/src"
  ln -sfn "/usr/lib/rustlib/$host/lib" "$prefix/lib/rustlib/$host/lib"
  ln -sfn "$(linker)" "$prefix/lib/rustlib/$host/bin/rust-lld"
  printf '#!/bin/sh\nexec %s --sysroot "%s" "$@"\n' "$rustc" "$prefix" >"$prefix/bin/rustc"
  printf '#!/bin/sh\nRUSTC="${RUSTC:-%s/bin/rustc}" exec %s "$@"\n' "$prefix" "$cargo" >"$prefix/bin/cargo"
  chmod +x "$prefix/bin/rustc" "$prefix/bin/cargo"
}

build_core() ( # core, alloc and compiler_builtins of every target with embedded bitcode (for LTO), once
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  mkdir "$scratch/src" "$scratch/.cargo"
  echo '#![no_std]' >"$scratch/src/lib.rs"
  printf '[package]\nname = "seed"\nversion = "0.0.0"\nedition = "2021"\n[profile.release]\ncodegen-units = 1\n' \
    >"$scratch/Cargo.toml"
  # The library's own dependencies come with its source: nothing is downloaded.
  printf '[source.crates-io]\nreplace-with = "vendored"\n[source.vendored]\ndirectory = "%s/vendor"\n' "$library" \
    >"$scratch/.cargo/config.toml"
  cd "$scratch"
  for target in $targets; do
    say "building the core library of $target with rustc $(version release)"
    RUSTC=$rustc RUSTC_BOOTSTRAP=1 CARGO_HOME=$scratch/home RUSTFLAGS="-C embed-bitcode=yes" \
      CARGO_TARGET_DIR=$scratch/target "$cargo" build --quiet --offline --release -Z build-std=core,alloc --target "$target" >&2
    libraries=$prefix/lib/rustlib/$target/lib
    mkdir -p "$libraries"
    rm -f "$libraries/"*.rlib
    cp "target/$target/release/deps/"lib{core,alloc,compiler_builtins}-*.rlib "$libraries/"
  done
  version release >"$prefix/version"
)

with_debian() {
  command -v dpkg >/dev/null || { say "neither 'rustup target add $targets' nor Debian packages work here"; return 3; }
  install_packages || return $?
  [ "$(cat "$prefix/version" 2>/dev/null)" = "$(version release)" ] && has_core "$prefix/bin/rustc" && return 0
  [ "$(basename "$(readlink -f /usr/lib/rustlib/src/rust)")" = "rustc-$(version release)" ] ||
    { say "package rust-web-src does not match rustc $(version release)"; return 1; }
  lay_out
  build_core
}

if with_rustup; then
  echo cargo
else
  with_debian
  if command -v rustup >/dev/null; then
    rustup toolchain link "$name" "$prefix" >&2
    echo "cargo +$name"
  else
    echo "$prefix/bin/cargo"
  fi
fi
