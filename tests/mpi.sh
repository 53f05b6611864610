#!/usr/bin/env bash
# One, two and four processes under MPI leave the same files: a training run by PPO, one by gradients, one by gradients with a
# memory in drawn forests, and a study with an anchor and policy sharing.
# What a program with MPI is built from is what the other tests are built from.
#
#   tests/mpi.sh
#
# Installs Open MPI and libclang where they are missing and this is root. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/packages.sh
. tests/packages.sh
# shellcheck source=tests/programs.sh
. tests/programs.sh

need "MPI" mpi || exit 1
program_without_gpus || exit 1

# Tests run as root in containers and with more ranks than cores.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
ranks() { # NUMBER PROGRAM ARGUMENTS...
  local number=$1
  shift
  mpirun --oversubscribe --mca btl self,vader -n "$number" "$@"
}

train() { # FOLDER LAUNCHER...: trains in $place/FOLDER
  local folder=$1
  shift
  "$@" train configs/hover.yaml --run "$place/$folder" --threads 1 --set training.analytic=null \
    --set training.total_steps=131072 --set evaluation.episodes=16
}

gradients() { # FOLDER LAUNCHER...: as train, by gradients through the physics
  local folder=$1
  shift
  "$@" train configs/hover.yaml --run "$place/$folder" --threads 1 --set training.analytic.environments=256 \
    --set training.analytic.total_steps=61440 --set evaluation.episodes=16
}

forest() { # FOLDER LAUNCHER...: as gradients, with a memory, in forests that every episode draws
  local folder=$1
  shift
  "$@" train configs/aviaries/forest.yaml --run "$place/$folder" --threads 1 \
    --set scenario.aviary.drawn.worlds.count=8 --set evaluation.worlds.count=4 \
    --set training.analytic.environments=256 --set training.analytic.total_steps=76800 \
    --set evaluation.episodes=8
}

study() { # FOLDER LAUNCHER...
  local folder=$1
  shift
  "$@" study run tests/command_line/tiny-study.yaml --directory "$place/$folder" --threads 1 \
    --set training.environments=1024 --set seeds.count=1
}

packages() { # FEATURES: all that is built, with features of its own, but the program
  cargo tree --quiet --workspace --edges normal,build,dev --prefix none --format '{p} [{f}]' --features "$1" |
    sed 's/ (\*)$//' | grep -v '^kestrel v' | sort -u
}
built_from_the_same() { # says what is missing or has other features, and fails
  local others
  others=$(packages kestrel/gpu,kestrel/ros2,kestrel/viewer) && [ -n "$others" ] &&
    ! comm -23 <(echo "$others") <(packages kestrel/mpi,kestrel/ros2,kestrel/viewer) | grep .
}

check "with MPI nothing that others are built from is built again" built_from_the_same
check "a run of one process" train run-0 target/debug/kestrel
check "a run of one process by gradients" gradients gradients-0 target/debug/kestrel
check "a run of one process in forests" forest forest-0 target/debug/kestrel
check "a study of one process" study study-0 target/debug/kestrel
for number in 1 2 4; do
  check "a run of $number ranks" train "run-$number" ranks "$number" target/kestrel-without-gpus
  check "its policy is the same" cmp "$place/run-0/policy.kestrel" "$place/run-$number/policy.kestrel"
  for kind in gradients forest; do
    check "a run of $number ranks, $kind" $kind "$kind-$number" ranks "$number" target/kestrel-without-gpus
    check "its policy is the same" cmp "$place/$kind-0/policy.kestrel" "$place/$kind-$number/policy.kestrel"
  done
  check "a study of $number ranks" study "study-$number" ranks "$number" target/kestrel-without-gpus
  check "its rows are the same" diff -r "$place/study-0/rows" "$place/study-$number/rows"
done
says() { # WORDS COMMAND...: fails, and says this
  local words=$1
  shift
  ! "$@" >"$place/said" 2>&1 && grep -q "$words" "$place/said"
}
check "three ranks are refused" says "3 ranks cannot share" train run-3 ranks 3 target/kestrel-without-gpus
check "three ranks are refused by gradients" says "3 ranks cannot share" \
  gradients gradients-3 ranks 3 target/kestrel-without-gpus
check "a program without MPI refuses" says "was built without MPI" train run-n ranks 2 target/debug/kestrel

summary
