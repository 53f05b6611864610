# The two kinds of build that the suites in shell need, to be sourced from them. Everything but MPI and what the program says
# without GPUs is tested with the first: the tests in Rust are built together with it, from the same artefacts.
export CARGO_INCREMENTAL=${CARGO_INCREMENTAL:-0}

# A run directory with the pilot of a task: that of a training that is cut short.
run_with_pilot() { # TASK RUN
  rm -rf "$2"
  target/debug/kestrel train "configs/$1.yaml" --run "$2" --set training.total_steps=131072 \
    --set evaluation.episodes=16 >/dev/null 2>&1 &&
    cp "assets/pilots/$1.kestrel" "$2/policy.kestrel"
}

# The core's pilot for C, with no more of the core than it asks for: target/debug/libkestrel_pilot.a.
pilot_library() { # CARGO_COMMAND OPTION...
  # shellcheck disable=SC2086  # a command with arguments
  $1 rustc --quiet -p kestrel-crazyflie --lib --crate-type staticlib "${@:2}"
}

# A policy file as the C that `kestrel export` writes beside the pilot for C.
policy_as_c() { # POLICY
  echo '#include "policy.h"'
  echo 'const uint8_t kestrel_policy[] __attribute__((aligned(8))) = {'
  od -An -v -tx1 "$1" | sed 's/ \(..\)/0x\1,/g'
  echo '}; const size_t kestrel_policy_len = sizeof kestrel_policy;'
}

# With GPUs and the viewer: every program in target/debug, and every test.
programs() {
  cargo build --quiet --workspace --lib --bins --tests --features kestrel/gpu,kestrel/ros2,kestrel/viewer
}

# Without GPUs, and with MPI where it is installed: target/kestrel-without-gpus. What it depends on is what was built above,
# because features are those of the whole workspace with the viewer, and of a test.
program_without_gpus() {
  local features=kestrel/ros2,kestrel/viewer
  ! command -v mpicc >/dev/null || features=kestrel/mpi,$features
  cargo build --quiet --workspace --bin kestrel --test suite --features "$features" &&
    cp target/debug/kestrel target/kestrel-without-gpus && programs
}
