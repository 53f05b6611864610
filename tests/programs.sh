# The two kinds of build that the suites in shell need, to be sourced from them. Everything but MPI and what the program says
# without GPUs is tested with the first: the tests in Rust are built together with it, from the same artefacts.
export CARGO_INCREMENTAL=${CARGO_INCREMENTAL:-0}

# With GPUs and the viewer: every program in target/debug, and every test.
programs() {
  cargo build --quiet --workspace --all-targets --features kestrel/gpu,kestrel/viewer
}

# Without GPUs, and with MPI where it is installed: target/kestrel-without-gpus. A test is built with it so that what it
# depends on has the same features as above, and is not compiled again.
program_without_gpus() {
  local features=()
  ! command -v mpicc >/dev/null || features=(--features kestrel/mpi)
  cargo build --quiet --workspace --bin kestrel --test suite "${features[@]}" &&
    cp target/debug/kestrel target/kestrel-without-gpus && programs
}
