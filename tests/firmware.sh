#!/usr/bin/env bash
# The same bits and a known price on the microcontroller: builds the images of firmware-shim/image, runs them in QEMU
# and Node, and compares.
#
#   tests/firmware.sh
#
# Conformance: four policies of assets/pilots, in both arithmetics, with its golden vectors, 100,000 random inputs and
# 2,000 control periods, the anchor of learning over 100 tasks, signed MAVLink frames, and eleven flights of the whole autopilot with
# its failsafes; the digests of the STM32F405, AN386, RISC-V and WebAssembly must be those of this machine. An image in which a
# panic could be reached does not link.
#
# C: the app for crazyflie-firmware around the static library flies and refuses damaged policies, built with Bitcraze's
# flags and linked in Bitcraze's way, on the STM32F405 as it does here.
#
# Exported C: at Bitcraze's -Os and at -O3, with the DSP extension and without, and with -ffast-math, the bits of this machine in at most as
# many instructions as are promised, also of 12,000 special inputs; as C++ too.
#
# Processor in the loop: the simulator flies episodes by the rotor targets of the STM32F405 behind a serial line, which must be
# those of this machine; EPISODES of hover, of cross, and of hover with an imported network, 64 unless told otherwise.
#
# Budget: every part of a control period in instructions, stack, flash and RAM, against firmware-shim/image/budget.json to
# within 2 %, and against what is promised. BLESS=1 writes budget.json and BUDGET.md anew.
#
# Needs Rust, gcc and Node; QEMU and the binutils come from Debian when this is root. Ends with "N passed, N failed".
set -uo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/checks.sh
. tests/checks.sh
# shellcheck source=tests/packages.sh
. tests/packages.sh
# shellcheck source=tests/programs.sh
. tests/programs.sh

out=target/firmware
mkdir -p "$out"

image() { # NAME PROGRAM TARGET [CARGO OPTION...]: builds an image into $out/NAME
  local name=$1 program=$2 target=$3 flags="" file
  shift 3
  case $target in thumb*) flags="-C target-cpu=cortex-m4" ;; esac
  # shellcheck disable=SC2086  # a command with arguments
  RUSTFLAGS=$flags $cargo build --quiet -p kestrel-image --profile firmware --target "$target" --bin "$program" "$@" || return 1
  file=target/$target/firmware/$program
  [ -f "$file" ] || file=$file.wasm
  cp "$file" "$out/$name"
}

emulated() { # MACHINE IMAGE [QEMU OPTION...]: what the image prints
  local machine=$1 kernel=$2 qemu=qemu-system-arm firmware=""
  shift 2
  [ "$machine" = virt ] && qemu=qemu-system-riscv32 && firmware="-bios none"
  # shellcheck disable=SC2086  # an option with its value, or nothing
  timeout 600 $qemu -M "$machine" $firmware -nographic -monitor none -serial none -chardev stdio,id=console \
    -semihosting-config enable=on,target=native,chardev=console -kernel "$kernel" "$@" </dev/null
}

same_as_here() { # NAME STATUS: whether the digests of a machine are those of this one
  local expected=$out/x86-64.txt
  # Without floating point 100,000 inputs in float take minutes: RISC-V stops after 5,000.
  if [ "$1" = riscv32 ]; then
    grep -v 'float32: 100,000' "$expected" >"$out/expected.txt"
    expected=$out/expected.txt
  fi
  [ "$2" -eq 0 ] && [ -s "$expected" ] && diff "$expected" "$out/$1.txt"
  verdict $? "$(wc -l <"$expected") digests of $1 are those of this machine"
}

conformance() {
  local status=()
  programs && target/debug/conformance >"$out/x86-64.txt"
  verdict $? "every policy of the image passes its self-test here"
  image stm32f405.elf conformance thumbv7em-none-eabihf --features assembly
  verdict $? "the image of the STM32F405, with the kernel in assembly, links without a panic"
  image an386.elf conformance thumbv7em-none-eabihf --features an386,smlad
  verdict $? "the image of AN386, with SMLAD in Rust, links without a panic"
  image riscv32.elf conformance riscv32imac-unknown-none-elf
  verdict $? "the image of RISC-V links without a panic"
  image page.wasm conformance wasm32-unknown-unknown
  verdict $? "the image of WebAssembly builds"
  emulated netduinoplus2 "$out/stm32f405.elf" >"$out/stm32f405.txt" &
  status[0]=$!
  emulated mps2-an386 "$out/an386.elf" >"$out/an386.txt" &
  status[1]=$!
  emulated virt "$out/riscv32.elf" >"$out/riscv32.txt" &
  status[2]=$!
  node tests/firmware/page.mjs "$out/page.wasm" >"$out/wasm32.txt"
  same_as_here wasm32 $?
  wait "${status[0]}"
  same_as_here stm32f405 $?
  wait "${status[1]}"
  same_as_here an386 $?
  wait "${status[2]}"
  same_as_here riscv32 $?
}

app_here() { # FILE [DEFINITION]: what the app does, by the processor of this machine
  gcc -O2 -Wall -Wextra -Werror "${@:2}" "${include[@]}" "${app[@]}" target/debug/libkestrel_pilot.a -lpthread -ldl -lm -o "$out/app" &&
    "$out/app" >"$1" && cat "$1"
}

right_thrust() { # FILE: whether the policy flew, with the thrust that the firmware's constants ask for in every tick
grep -qE ', ([0-9]{4,}) of the policy,.* right thrust in \1:' "$1"
}

app_on_target() { # FOLDER KBUILD: app-stm32f405.elf in the folder, around the pilot.o of the app's own Kbuild
  local to=$1 kbuild=$2 file objects=()
  local machine=(-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16)
  local flags=("${machine[@]}" -g3 -fno-math-errno -mfp16-format=ieee -std=gnu11 -fno-strict-aliasing
    -ffunction-sections -fdata-sections -Os -Wall -Wextra -Werror)
  mkdir -p "$to" && rm -f "$to/pilot.o"
  # crazyflie-firmware links with its compiler.
  make --silent -f "$kbuild" obj="$to" KESTREL="$PWD" CARGO="$cargo" LD=arm-none-eabi-gcc "$to/pilot.o" || return 1
  for file in "${app[@]}" tests/firmware/crazyflie/start.c; do
    objects+=("$to/$(basename "$file" .c).o")
    arm-none-eabi-gcc "${flags[@]}" "${include[@]}" -c "$file" -o "${objects[-1]}" || return 1
  done
  arm-none-eabi-ld -r -z noexecstack -o "$to/built-in.o" "${objects[@]}" "$to/pilot.o" &&
    arm-none-eabi-gcc "${machine[@]}" --specs=rdimon.specs --specs=nano.specs -nostartfiles -Wl,--gc-sections \
      -T tests/firmware/crazyflie/stm32f405.ld "$to/built-in.o" -o "$to/app-stm32f405.elf"
}

only_entries() { # whether the firmware sees of the pilot what it calls, and the pilot nothing of the firmware
  local names
  names=$(arm-none-eabi-nm -g "$out/pilot.o" | awk '{ print $(NF - 1), $NF }' | sort | tr '\n' ' ')
  [ "$names" = "T kestrel_compensate_rotors T kestrel_control_period T kestrel_follow_rates T kestrel_greatest_thrust T kestrel_reset T kestrel_rotor_shares T kestrel_scan T kestrel_take_policy T kestrel_tick_measured " ]
}

app_size() { # COLUMN of `size`, beside initial values: of the pilot and of its controller
  arm-none-eabi-size "$out/pilot.o" "$out/kestrel_controller.o" | awk -v column="$1" 'NR > 1 { sum += $column + $2 } END { print sum }'
}

crazyflie() {
  local size
  local include=(-I firmware-shim/crazyflie/include -I tests/firmware/crazyflie)
  local app=(tests/firmware/crazyflie/main.c firmware-shim/crazyflie/app/kestrel_controller.c "$out/policy.c")
  policy_as_c assets/pilots/hover.kestrel >"$out/policy.c"
  pilot_library cargo && app_here "$out/app.txt" && right_thrust "$out/app.txt"
  verdict $? "the app for crazyflie-firmware flies here, with the thrust of a Crazyflie 2.1"
  app_here "$out/app-upgrade.txt" -DCONFIG_CRAZYFLIE_THRUST_UPGRADE_KIT && right_thrust "$out/app-upgrade.txt"
  verdict $? "with the thrust of the upgrade kit"
  app_here "$out/app-brushless.txt" -DCONFIG_PLATFORM_CF21BL && right_thrust "$out/app-brushless.txt"
  verdict $? "with the thrust of a Crazyflie 2.1 Brushless"
  app_here "$out/app-pwm.txt" -DWITHOUT_COMPENSATION && right_thrust "$out/app-pwm.txt" && grep -q 'by PWM: 1' "$out/app-pwm.txt"
  verdict $? "with duty cycles for an empty battery, in a firmware that does not compensate it"
  grep -q 'a set-point is flown to for 999 ms' "$out/app.txt" && grep -q ' 0 rotors stopped' "$out/app.txt"
  verdict $? "it holds through a lost sample, and stops listening to an old set-point"
  grep -q 'unasked: 1000 1000 1000 1000' "$out/app.txt" && grep -qE 'that sinks: ([4-9][0-9]{2} ?){4}' "$out/app.txt" &&
    grep -q 'switched off: 1000 1000 1000 1000' "$out/app.txt"
  verdict $? "it learns what its rotors lack when it is told to, and forgets it"
  grep -qE 'of 12000 special states [0-9]{4,} refused, [0-9]{4,} flown or held, in which 0 rotors stopped' "$out/app.txt"
  verdict $? "12,000 states with special values are refused or flown, and no rotor stops"
  app_on_target "$out" firmware-shim/crazyflie/app/Kbuild
  verdict $? "it links with Bitcraze's flags, without a panic"
  only_entries
  verdict $? "it takes the place of nothing in the firmware's libraries"
  size=$(app_size 1)
  [ "$size" -gt 10000 ] && [ "$size" -le 37500 ]
  verdict $? "it takes $size bytes of flash beside the policy, at most 37,500"
  size=$(app_size 3)
  [ "$size" -gt 1000 ] && [ "$size" -le 7000 ]
  verdict $? "it takes $size bytes of RAM, at most 7,000"
  emulated netduinoplus2 "$out/app-stm32f405.elf" >"$out/app-stm32f405.txt" && diff "$out/app.txt" "$out/app-stm32f405.txt"
  verdict $? "it flies the same on the STM32F405, and refuses the same policies"
}

scan_on_target() { # PILOT LIMIT: the beams that its app casts have the bits of this machine, and take at most LIMIT instructions
  local pilot=$1 limit=$2 folder=$out/scan-$1 most
  local machine=(-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16)
  target/debug/kestrel export "$pilot" --target crazyflie --output "$folder" >/dev/null &&
    gcc -O2 -ffp-contract=off -Wall -Wextra -Werror -I "$folder/crazyflie" "$folder/crazyflie/policy.c" tests/firmware/scan/main.c \
      target/debug/libkestrel_pilot.a -lpthread -ldl -lm -o "$folder/here" && "$folder/here" >"$folder/here.txt" &&
    grep -qE '^room 0: [0-9]{3,} beams' "$folder/here.txt" &&
    arm-none-eabi-gcc "${machine[@]}" -Os -ffp-contract=off -Wall -Wextra -Werror -I "$folder/crazyflie" --specs=rdimon.specs \
      --specs=nano.specs -nostartfiles -Wl,--gc-sections -T tests/firmware/crazyflie/stm32f405.ld \
      "$folder/crazyflie/policy.c" tests/firmware/scan/main.c tests/firmware/crazyflie/start.c "$out/pilot.o" \
      -o "$folder/there.elf" &&
    windows "$folder/there.elf" "$folder/counts" >"$folder/there.txt" && diff "$folder/here.txt" "$folder/there.txt"
  verdict $? "the beams that the app of $pilot casts have the bits of this machine on the STM32F405"
  most=$(longest "$folder/counts")
  [ "$most" -gt 1000 ] && [ "$most" -le "$limit" ]
  verdict $? "they take $most instructions at most, of $limit"
}

in_the_loop() { # TASK
  run_with_pilot "$1" "$out/run-$1" &&
    target/debug/kestrel evaluate "$out/run-$1" --episodes "${EPISODES:-64}" --processor qemu --image "$out/pilot.elf"
}

windows() { # IMAGE COUNTS: what the image prints; its instructions between calls of mark() are counted
  local mark
  mark=$(arm-none-eabi-nm "$1" | awk '$3 == "mark" { print $1 }') &&
    emulated netduinoplus2 "$1" -plugin "$out/instruction_count.so,out=$2,mark=$mark"
}

longest() { # FILE: instructions of the longest call; windows end in turn before and after one, the last two belong to what follows
  awk '/window/ { if (++window % 2 && window > 1 && sum > most) most = sum; sum = 0; next } { sum += $2 }
    END { print most }' "$1"
}

c_on_target() { # NAME OPTIMISATION LIMIT FLAG...: the exported C has the bits of this machine, and takes at most LIMIT instructions
  local name="$1, $2" optimisation=$2 limit=$3 file=$out/c-${1// /-}$2 most
  shift 3
  local machine=(-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16)
  arm-none-eabi-gcc "${machine[@]}" -std=c99 "$optimisation" "$@" -Wall -Wextra -Wconversion -pedantic -Werror -c "$exported/policy.c" -o "$file.o" &&
    arm-none-eabi-gcc "${machine[@]}" -O2 -I "$exported" --specs=rdimon.specs --specs=nano.specs -nostartfiles \
      -T tests/firmware/crazyflie/stm32f405.ld "$file.o" tests/firmware/c/main.c tests/firmware/crazyflie/start.c \
      -o "$file.elf" &&
    windows "$file.elf" "$file.counts" >"$file.txt" && diff "$out/c.txt" "$file.txt"
  verdict $? "the exported C, $name, has the bits of this machine on the STM32F405"
  most=$(longest "$file.counts")
  [ "$most" -gt 1000 ] && [ "$most" -le "$limit" ]
  verdict $? "the exported C, $name, takes $most instructions an inference, at most $limit"
}

exported_c() { # of 22-64-64-4, as peers are measured
  local exported=$out/run-hover-cf2x
  run_with_pilot hover-cf2x "$exported" && target/debug/kestrel export "$exported" --target c >/dev/null &&
    gcc -O2 -I "$exported" "$exported/policy.c" tests/firmware/c/main.c -o "$out/c" && "$out/c" >"$out/c.txt" &&
    grep -q '^0 failed in the self-test' "$out/c.txt"
  verdict $? "the exported C passes its self-test here"
  g++ -x c++ -Os -ffast-math -Wall -Wextra -Wconversion -pedantic -Werror -c "$exported/policy.c" -o "$out/c-plus.o" &&
    gcc -O2 -I "$exported" "$out/c-plus.o" tests/firmware/c/main.c -o "$out/c-plus" 2>/dev/null
  verdict $? "it is C++ as well"
  c_on_target "with the DSP extension" -Os 10500
  c_on_target "with -ffast-math" -Os 10500 -ffast-math
  c_on_target "portable" -Os 17900 -U__ARM_FEATURE_DSP
  c_on_target "with the DSP extension" -O3 10500
  c_on_target "portable" -O3 17900 -U__ARM_FEATURE_DSP
}

memory_in_the_loop() { # as many episodes; it is trained for seconds, to fly, not to be good at it
  rm -rf "$out/run-memory"
  target/debug/kestrel train configs/aviaries/takeoff.yaml --run "$out/run-memory" --set training.total_steps=131072 \
    --set training.minibatch=4096 --set training.memory.units=8 --set evaluation.episodes=16 >/dev/null 2>&1 &&
    target/debug/kestrel evaluate "$out/run-memory" --episodes "${EPISODES:-64}" --processor qemu --image "$out/pilot.elf"
}

app_with_memory() { # the app around that policy flies on the STM32F405 on the stack that it has
  local folder=$out/run-memory/crazyflie to=$out/memory
  local include=(-I "$folder" -I tests/firmware/crazyflie)
  local app=(tests/firmware/crazyflie/main.c "$folder/kestrel_controller.c" "$folder/policy.c")
  target/debug/kestrel export "$out/run-memory" --target crazyflie >/dev/null && app_on_target "$to" "$folder/Kbuild" &&
    emulated netduinoplus2 "$to/app-stm32f405.elf" >"$to/app.txt" && cat "$to/app.txt" && right_thrust "$to/app.txt" &&
    ! grep -q overflows "$to/app.txt"
}

imported_in_the_loop() { # as many episodes
  rm -rf "$out/run-imported"
  target/debug/kestrel import tests/golden/foreign/sb3-ppo.onnx --task configs/hover.yaml -o "$out/run-imported" \
    --set evaluation.episodes=16 >/dev/null &&
    target/debug/kestrel evaluate "$out/run-imported" --episodes "${EPISODES:-64}" --processor qemu --image "$out/pilot.elf"
}

processor() {
  local task
  image pilot.elf pilot thumbv7em-none-eabihf --features assembly,serial && programs
  verdict $? "the image of a pilot behind a serial line links without a panic"
  for task in hover cross; do
    in_the_loop "$task"
    verdict $? "the STM32F405 flies $task with the motor commands of this machine"
  done
  memory_in_the_loop
  verdict $? "the STM32F405 flies a policy with a memory with the motor commands of this machine"
  app_with_memory
  verdict $? "the app for crazyflie-firmware flies it there"
  imported_in_the_loop
  verdict $? "the STM32F405 flies a network of Stable-Baselines3 with the motor commands of this machine"
}

counted() { # NAME TARGET MACHINE FEATURES: the files that budget.py wants of an image
  local name=$1 target=$2 machine=$3 features=$4 mark
  image "$name.elf" budget "$target" --features "$features" &&
    image "flight-$name.elf" flight "$target" --no-default-features --features "$features" &&
    image "inference-$name.elf" inference "$target" --no-default-features --features "$features" &&
    mark=$(python3 tests/firmware/budget.py --folder "$out" --committed firmware-shim/image --mark "$out/$name.elf") &&
    emulated "$machine" "$out/$name.elf" -plugin "$out/instruction_count.so,out=$out/$name.counts,mark=$mark" >"$out/$name.txt" &&
    emulated "$machine" "$out/flight-$name.elf" &&
    emulated "$machine" "$out/inference-$name.elf"
  verdict $? "the parts of $name run between marks, and a firmware of it flies"
}

compiler() { # its version, from the cargo command
  case $cargo in
  cargo*) rustc ${cargo#cargo} -V ;;
  *) "${cargo%cargo}rustc" -V ;;
  esac
}

budget() {
  gcc -O2 -Wall -Wextra -Werror -shared -fPIC -o "$out/instruction_count.so" tests/firmware/instruction_count.c
  verdict $? "the counter of instructions builds"
  counted stm32f405-assembly thumbv7em-none-eabihf netduinoplus2 budget,assembly
  counted stm32f405-smlad thumbv7em-none-eabihf netduinoplus2 budget,smlad
  counted stm32f405-portable thumbv7em-none-eabihf netduinoplus2 budget
  counted riscv32-portable riscv32imac-unknown-none-elf virt budget
  # shellcheck disable=SC2086  # an option or nothing
  python3 tests/firmware/budget.py --folder "$out" --committed firmware-shim/image --rustc "$(compiler)" ${BLESS:+--bless}
  verdict $? "the figures are those of firmware-shim/image/budget.json, and what is promised"
}

if need "an emulator or a tool" emulators && cargo=$(tests/embedded-toolchain.sh); then
  conformance
  crazyflie
  processor
  budget
  exported_c
  scan_on_target crosses 16000
  scan_on_target room-1 93000
else
  verdict 1 "this machine has what the images need"
fi
summary
