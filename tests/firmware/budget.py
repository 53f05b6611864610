"""What a control period costs on a microcontroller: budget.json and a table, from counted instructions.

    python3 budget.py --folder OUT --committed FOLDER --rustc VERSION [--bless]

OUT has, for each image NAME of IMAGES, NAME.elf, NAME.txt (what it printed) and NAME.counts (from instruction_count.so), and
flight-NAME.elf and inference-NAME.elf (a firmware with one policy, and one with its network only). FOLDER has budget.json and BUDGET.md, which are compared to within 2 %, or
written with --bless. Exit status 1: a figure has moved, or is beyond its limit. Another compiler than that of budget.json
writes other instructions: then only the limits are checked.

Instructions are counted, exactly. Cycles are a model of a Cortex-M4 without wait states of its flash, from the table of its
manual (ARM DDI 0439): at best loads pipeline behind each other and a taken branch refills in one cycle, at worst every
load takes two cycles and every branch that may be taken three more. Streaming the weights from the STM32F405's flash at
168 MHz may cost as much again as its five wait states for each line of sixteen bytes (RM0090, section 3.5.1), which stands
apart: weights in RAM do not pay it. Caches of instructions, buses and interrupts are not modelled: nothing here was
measured on a board.
"""

import argparse
import json
import re
import struct
import subprocess
import sys
import textwrap
from pathlib import Path

CLOCK_HZ = 168e6
TOLERANCE = 0.02
RAM_START = 0x20000000

# Name of an image: what it is measured for. The model of cycles is that of the Cortex-M4 only.
IMAGES = {
    "stm32f405-assembly": ("STM32F405", "SMLAD in assembly", True),
    "stm32f405-smlad": ("STM32F405", "SMLAD in Rust", True),
    "stm32f405-portable": ("STM32F405", "portable Rust", True),
    "riscv32-portable": ("rv32imac", "portable Rust", False),
}

# Greatest values that are promised, of (image, part, arithmetic, figure).
LIMITS = {
    ("stm32f405-assembly", "step", "fixed16", "instructions"): 7_500,
    ("stm32f405-assembly", "recurrent-step", "fixed16", "instructions"): 22_000,
    ("stm32f405-assembly", "image", "fixed16", "instructions"): 940_000,
    ("stm32f405-assembly", "seeing-step", "fixed16", "instructions"): 25_000,
    ("stm32f405-assembly", "firmware", "", "network_flash_bytes"): 16_384,
    ("stm32f405-assembly", "tick", "fixed16", "instructions"): 12_000,
    ("stm32f405-assembly", "tick", "fixed16", "cycles_most"): 16_800,
    ("stm32f405-assembly", "tick", "fixed16", "stack_bytes"): 1_024,
    ("stm32f405-smlad", "step", "fixed16", "instructions"): 8_500,
    ("stm32f405-smlad", "firmware", "", "network_flash_bytes"): 16_384,
    ("stm32f405-smlad", "tick", "fixed16", "instructions"): 12_000,
    ("stm32f405-smlad", "tick", "fixed16", "stack_bytes"): 1_024,
}

# Bytes of weights and biases that a part streams from flash: 22-64-64-4 for the pilots, 16-64-64-4 for a step.
STREAMED = {
    ("step", "fixed16"): 11_280,
    ("tick", "fixed16"): 12_048,
    ("step", "float32"): 22_032,
    ("recurrent-step", "fixed16"): 24_976,
    ("recurrent-step", "float32"): 49_040,
    ("tick", "float32"): 23_568,
    ("seeing-step", "fixed16"): 45_456,
    ("seeing-step", "float32"): 90_000,
}

LOAD = re.compile(r"^(ldr|ldrb|ldrh|ldrsb|ldrsh|vldr|str|strb|strh|vstr)$")
PAIR = ("ldrd", "strd")
MULTIPLE = ("push", "pop", "ldm", "stm", "ldmia", "stmia", "ldmdb", "stmdb", "vldmia", "vstmia", "vpush", "vpop")
BRANCH = re.compile(r"^(b|bl|blx|bx|cbz|cbnz|b(eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le))$")
FLOAT = ("vadd", "vsub", "vmul", "vfma", "vfms", "vmla", "vmls", "vnmul", "vcvt", "vdiv", "vsqrt")


class Elf:
    """Of a 32-bit little-endian image: where `symbol`s lie, and what it puts into flash and RAM."""

    def __init__(self, path):
        self.data = Path(path).read_bytes()

    def segments(self):
        offset, size, count = struct.unpack_from("<I", self.data, 28)[0], *struct.unpack_from("<HH", self.data, 42)
        for index in range(count):
            yield struct.unpack_from("<8I", self.data, offset + index * size)

    def flash(self):
        return sum(filesz for kind, _, _, _, filesz, _, _, _ in self.segments() if kind == 1)

    def statics(self):
        in_ram = [segment[5] for segment in self.segments() if segment[0] == 1 and RAM_START <= segment[2] < 2 * RAM_START]
        return sum(in_ram)

    def sections(self):
        """(name, type, offset, size, link) of each section."""
        at, size, count, names = *struct.unpack_from("<I", self.data, 32), *struct.unpack_from("<3H", self.data, 46)
        headers = [struct.unpack_from("<10I", self.data, at + index * size) for index in range(count)]
        return [(self.text(headers[names][4] + header[0]), header[1], *header[4:7]) for header in headers]

    def text(self, start):
        return self.data[start : self.data.index(0, start)].decode()

    def symbols(self):
        """(name, address, size) of each symbol."""
        sections = self.sections()
        for _, kind, offset, length, link in sections:
            if kind != 2:
                continue
            for at in range(offset, offset + length, 16):
                name, value, size = struct.unpack_from("<3I", self.data, at)
                yield self.text(sections[link][2] + name), value & ~1, size

    def symbol(self, wanted):
        return next(value for name, value, _ in self.symbols() if name == wanted)

    def network(self):
        """Weights, tables and code of an inference, in an image that has nothing else: not what starts it up."""
        constants = sum(size for name, _, _, size, _ in self.sections() if name == ".rodata")
        return constants + sum(size for name, _, size in self.symbols() if "kestrel_core" in name and "fixed" in name)


def windows(path):
    """Executions of each address, window by window."""
    found = []
    for line in Path(path).read_text().splitlines():
        if line == "window":
            found.append({})
        else:
            address, count = line.split()
            found[-1][int(address, 16)] = int(count)
    return found


def disassembly(elf):
    """(address, mnemonic without width, operands) of each instruction, function by function."""
    functions = []
    text = subprocess.run(["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", elf], capture_output=True, text=True, check=True)
    for line in text.stdout.splitlines():
        if re.match(r"^[0-9a-f]+ <.*>:$", line):
            functions.append([])
        elif (match := re.match(r"^\s*([0-9a-f]+):\t(\S+)\s*(.*)$", line)) and functions and not match[2].startswith("."):
            mnemonic = re.sub(r"\.(w|n)$", "", match[2])
            functions[-1].append((int(match[1], 16), mnemonic, match[3].split("@")[0].strip()))
    return functions


def registers(operands):
    """How many registers stand in the braces."""
    count = 0
    for part in re.search(r"\{(.*)\}", operands)[1].split(","):
        ends = [int(re.sub(r"\D", "", end) or 0) for end in part.split("-")]
        count += ends[1] - ends[0] + 1 if len(ends) == 2 else 1
    return count


def cycles(instructions, index):
    """At best and at worst, without the refill after a branch."""
    _, mnemonic, operands = instructions[index]
    root = mnemonic.split(".")[0]
    if LOAD.match(root):
        behind_another = index > 0 and LOAD.match(instructions[index - 1][1].split(".")[0])
        return (1 if behind_another else 2), 2
    if root in PAIR:
        return 3, 3
    if root in MULTIPLE:
        count = 1 + registers(operands)
        return count, count
    if root in ("sdiv", "udiv"):
        return 2, 12
    cost = 14 if root in ("vdiv", "vsqrt") else 3 if root in ("vfma", "vfms", "vmla", "vmls") else 1
    if root in FLOAT and index + 1 < len(instructions):
        _, following, sources = instructions[index + 1]
        sources = [source.strip() for source in sources.split(",")]
        reads_first = following.split(".")[0] in ("vfma", "vmla", "vcmp", "vcmpe", "vstr", "vfms", "vmls")
        if operands.split(",")[0].strip() in (sources if reads_first else sources[1:]):
            cost += 1
    return cost, cost


def modelled(functions, counts):
    """Cycles of a window, at best and at worst."""
    least = most = 0
    for instructions in functions:
        for index, (address, mnemonic, operands) in enumerate(instructions):
            count = counts.get(address, 0)
            if count == 0:
                continue
            best, worst = cycles(instructions, index)
            least, most = least + best * count, most + worst * count
            returns = mnemonic.startswith(("pop", "ldm")) and "pc" in operands
            if BRANCH.match(mnemonic) or returns:
                always = returns or mnemonic in ("b", "bl", "bx", "blx")
                following = counts.get(instructions[index + 1][0], 0) if index + 1 < len(instructions) else 0
                least += count if always else max(0, count - following)
                most += 3 * count
    return least, most


def measured(folder, name):
    """The greatest figures of each part of an image."""
    target, kernel, has_model = IMAGES[name]
    elf = folder / f"{name}.elf"
    functions = disassembly(elf) if has_model else []
    found = windows(folder / f"{name}.counts")
    printed = [line.split() for line in (folder / f"{name}.txt").read_text().splitlines()]
    sizes = {line[1]: int(line[2]) for line in printed if line[0] == "pilot-bytes"}
    printed = [line for line in printed if line[0] != "pilot-bytes"]
    nothing = found[1]
    parts = {}
    for index, (part, arithmetic, stack) in enumerate(printed[1:], start=1):
        counts = found[2 * index + 1]
        row = parts.setdefault((part, arithmetic), {"part": part, "arithmetic": arithmetic, "instructions": 0, "stack_bytes": 0})
        row["instructions"] = max(row["instructions"], sum(counts.values()) - sum(nothing.values()))
        row["stack_bytes"] = max(row["stack_bytes"], int(stack))
        if has_model:
            add_cycles(row, modelled(functions, counts), modelled(functions, nothing))
    flight = Elf(folder / f"flight-{name}.elf")
    return {
        "image": name,
        "target": target,
        "kernel": kernel,
        "network_flash_bytes": Elf(folder / f"inference-{name}.elf").network(),
        "firmware_flash_bytes": flight.flash(),
        "static_ram_bytes": flight.statics(),
        "pilot_bytes": sizes["pilot"],
        "effectiveness_bytes": sizes["effectiveness"],
        "parts": list(parts.values()),
    }


def add_cycles(row, window, nothing):
    row["cycles_least"] = max(row.get("cycles_least", 0), window[0] - nothing[0])
    row["cycles_most"] = max(row.get("cycles_most", 0), window[1] - nothing[1])
    streamed = STREAMED.get((row["part"], row["arithmetic"]))
    if streamed:
        row["flash_wait_cycles"] = streamed // 16 * 5
        row["share_of_1_khz"] = round(row["cycles_most"] / (CLOCK_HZ / 1000), 4)
        row["share_of_500_hz"] = round(row["cycles_most"] / (CLOCK_HZ / 500), 4)


def table(budget):
    lines = [
        "# What a policy costs a microcontroller",
        "",
        wrapped(
            "`BLESS=1 tests/firmware.sh` writes this page; without `BLESS` it compares to within 2 %. "
            "*step*: one inference of 16-64-64-4. *tick*: a whole control period of the pilots in `assets/pilots` "
            "(22-64-64-4), state in, rotor targets out. *learn*: one learning step of the output layer of 16-64-64-4. "
            "*pull*: the continual-learning regulariser of its 260 parameters; both together keep 1.3 kB. "
            "*compensate*: what learns in flight which share of its thrust each rotor makes, and drives weak ones harder. "
            "*recurrent-step*: 16-64-64-4 behind a memory of 32 units. *image*: what an eye of 16 and 32 filters of 4 x 4 "
            "makes of 24 x 32 grey pixels, 64 features; *seeing-step*: 16-64-64-4 behind that and a memory of 32 units. "
            "QEMU counts the instructions; cycles are modelled (`tests/firmware/budget.py` says how). "
            "*flash* is what five wait states for each sixteen bytes of weights may add. "
            "Shares are those of the worst case without it at 168 MHz. Stack is what a call writes to. "
            f"Built with {budget['rustc']}. No board was measured."
        ),
        "",
    ]
    for image in budget["images"]:
        lines += [
            f"## {image['target']}, {image['kernel']}",
            "",
            wrapped(
                f"Flash: {image['network_flash_bytes']:,} bytes for weights, table and code of 16-64-64-4 in fixed point; "
                f"{image['firmware_flash_bytes']:,} for a whole program that flies it, with the parser and all controllers. "
                f"RAM: {image['pilot_bytes']:,} bytes for the pilot, {image['effectiveness_bytes']} more where it makes up for "
                f"weak rotors, {image['static_ram_bytes']} of statics. "
                "No heap, no panic in reach."
            ),
            "",
            "| part | arithmetic | instructions | cycles | flash | µs | of 1 kHz | of 500 Hz | stack |",
            "|---|---|---|---|---|---|---|---|---|",
        ]
        for row in image["parts"]:
            model = ["–"] * 5
            if "cycles_least" in row:
                least, most = row["cycles_least"], row["cycles_most"]
                shares = [f"{100 * row[key]:.1f} %" if key in row else "–" for key in ("share_of_1_khz", "share_of_500_hz")]
                waits = f"+ {row['flash_wait_cycles']:,}" if "flash_wait_cycles" in row else "–"
                model = [f"{least:,}–{most:,}", waits, f"{least / CLOCK_HZ * 1e6:.0f}–{most / CLOCK_HZ * 1e6:.0f}", *shares]
            cells = [row["part"], row["arithmetic"], f"{row['instructions']:,}", *model, f"{row['stack_bytes']:,}"]
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines)


def wrapped(paragraph):
    """The Markdown of this repository has 100 columns."""
    return textwrap.fill(paragraph, 100, break_on_hyphens=False)


def figures(budget):
    """Every number under its name."""
    for image in budget["images"]:
        for key in ("network_flash_bytes", "firmware_flash_bytes", "static_ram_bytes", "pilot_bytes", "effectiveness_bytes"):
            yield (image["image"], "firmware", "", key), image[key]
        for row in image["parts"]:
            for key, value in row.items():
                if not isinstance(value, str) and not key.startswith("share"):
                    yield (image["image"], row["part"], row["arithmetic"], key), value


def complaints(found, committed):
    same_compiler = found["rustc"] == committed["rustc"]
    if not same_compiler:
        print(f"built with {found['rustc']}, budget.json with {committed['rustc']}: only the limits are checked")
    found, committed = dict(figures(found)), dict(figures(committed) if same_compiler else figures(found))
    for name in sorted(found.keys() | committed.keys()):
        if name not in found or name not in committed:
            yield f"{' '.join(name)}: only in {'the measurement' if name in found else 'budget.json'}"
        elif abs(found[name] - committed[name]) > TOLERANCE * committed[name]:
            yield f"{' '.join(name)}: {found[name]:,}, budget.json has {committed[name]:,}"
    for name, limit in LIMITS.items():
        if found[name] > limit * (1 + TOLERANCE):
            yield f"{' '.join(name)}: {found[name]:,}, the limit is {limit:,}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--committed", type=Path, required=True)
    parser.add_argument("--rustc", help="what built the images")
    parser.add_argument("--bless", action="store_true")
    parser.add_argument("--mark", type=Path, help="print the address of the mark in this image, and nothing else")
    arguments = parser.parse_args()
    if arguments.mark:
        print(f"{Elf(arguments.mark).symbol('kestrel_mark'):x}")
        return
    budget = {"rustc": arguments.rustc, "clock_hz": CLOCK_HZ, "images": [measured(arguments.folder, name) for name in IMAGES]}
    path = arguments.committed / "budget.json"
    if arguments.bless:
        path.write_text(json.dumps(budget, indent=1) + "\n")
        (arguments.committed / "BUDGET.md").write_text(table(budget))
    print(table(budget))
    found = list(complaints(budget, json.loads(path.read_text())))
    for complaint in found:
        print(f"moved: {complaint}")
    sys.exit(1 if found else 0)


main()
