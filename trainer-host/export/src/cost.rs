//! What an exported policy takes of a Cortex-M4: a model, and what a compiler makes of it.
//!
//! Flash and RAM are sums of parts. Instructions were fitted to QEMU's counts of exported C with 22 inputs and hidden layers of
//! 16, 16-16, 32-32, 64-64 and 64-64-64 (1,587 to 16,223), which they meet within 2.5 %.

use core::fmt;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::Command;

use kestrel_core::policy_file::{PolicyFile, RecurrentPolicy};
use thiserror::Error;

use crate::policy::Policy;

/// Compiler for microcontrollers, and what counts its sections.
const COMPILER: &str = "arm-none-eabi-gcc";
const SIZE: &str = "arm-none-eabi-size";

/// As crazyflie-firmware is built.
const FLAGS: [&str; 5] = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-Os"];

/// Code of the exported C and its table of tangents \[bytes\].
const C_CODE: usize = 1460;
const C_TANGENTS: usize = 1540;

/// What a memory adds to the code \[bytes\].
const C_MEMORY_CODE: usize = 460;

/// Least stack of the exported C: an action, and the self-test \[bytes\].
const C_STACK: usize = 280;

/// Of exported C per block of four rows, per value of a hidden layer, per value of the observation, and always
/// \[instructions\]; two columns of a block take 7.5.
const C_PER_BLOCK: f64 = 32.0;
const C_PER_VALUE: f64 = 25.25;
const C_PER_INPUT: f64 = 25.0;
const C_ALWAYS: f64 = 110.0;

/// The same of the core's kernel in assembly, per block and per value.
const CORE_PER_BLOCK: f64 = 15.0;
const CORE_PER_VALUE: f64 = 15.0;

/// Of a block of four rows per two columns \[instructions\]: `smlad` and `ldrd`, written so that fifteen do sixteen products.
const PER_PAIR: f64 = 7.5;

/// The app around a policy: its code, its memory, and the stack that it takes of the stabiliser's task \[bytes\].
const APP_CODE: usize = 32_100;
const APP_MEMORY: usize = 6900;
const APP_STACK: usize = 760;

/// What a memory adds to both: the library has two kinds of pilots, and reading takes more of a stack of its own \[bytes\].
const APP_MEMORY_CODE: usize = 18_200;
const APP_MEMORY_RAM: usize = 2400;

/// The core's pilot in a firmware of one's own \[bytes\].
const CORE_CODE: usize = 30_000;
const CORE_MEMORY: usize = 2900;
const CORE_STACK: usize = 2400;

/// The controller for Betaflight's forks, which reads the policy on the stack of its caller \[bytes\].
const BETAFLIGHT_CODE: usize = 27_200;
const BETAFLIGHT_MEMORY: usize = 4000;

/// What PX4's model has beside its weights, and the arena of its interpreter \[bytes\].
const MODEL_REST: usize = 2200;
const ARENA: usize = 10 << 10;

/// Observation, rate loop and mixer of a control period \[instructions\].
const AROUND_NETWORK: f64 = 1400.0;

/// In which form a microcontroller is given a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The core's pilot, with the kernel in assembly.
    Rust,
    /// The network in C, with the DSP extension, at -Os.
    C,
    /// The app for crazyflie-firmware.
    Crazyflie,
    /// The controller for Betaflight's forks.
    Betaflight,
    /// The model for PX4's neural control.
    Px4,
}

/// What a policy will take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost {
    form: Form,
    /// Of all, and of the policy alone \[bytes\].
    flash: usize,
    policy: usize,
    /// Of the maps in which beams are cast \[bytes\].
    maps: usize,
    /// \[bytes\]
    ram: usize,
    stack: usize,
    /// Of a step of the C, or of a control period; none for policies with a camera or a memory.
    instructions: Option<usize>,
}

/// What a compiler made of exported C.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Built {
    /// \[bytes\]
    flash: usize,
    ram: usize,
}

/// Why exported C was not compiled.
#[derive(Debug, Error)]
pub enum BuildError {
    /// The system refused something.
    #[error("cannot run {program}: {reason}")]
    Run {
        /// What should run.
        program: &'static str,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// The compiler did.
    #[error("{COMPILER} refuses {}:\n{message}", path.display())]
    Refused {
        /// What was compiled.
        path: PathBuf,
        /// What the compiler said.
        message: String,
    },
    /// What counts sections said something else.
    #[error("{SIZE} said \"{0}\", expected the bytes of the sections")]
    Sections(String),
}

impl Cost {
    /// Of a policy whose file has `file_len` bytes.
    pub fn of(policy: &Policy<'_>, form: Form, file_len: usize) -> Self {
        let network = match policy {
            Policy::Blind(policy) => Some(policy.as_ref()),
            Policy::Recurrent(policy) if form == Form::C => return Self::of_remembering_c(policy),
            Policy::Recurrent(_) if form == Form::Crazyflie => {
                let sizes = [APP_CODE + APP_MEMORY_CODE, APP_MEMORY + APP_MEMORY_RAM, APP_STACK];
                return Self::of_pilot(form, (None, file_len), sizes);
            }
            Policy::Seeing(_) | Policy::Recurrent(_) => None,
        };
        match form {
            Form::C => Self {
                form,
                flash: network.map_or(file_len, c_flash),
                policy: network.map_or(file_len, PolicyFile::parameter_bytes),
                maps: 0,
                ram: network.map_or(0, |network| 6 * widest(network)),
                stack: C_STACK,
                instructions: network.map(c_instructions),
            },
            Form::Px4 => {
                let weights = network.map_or(file_len, PolicyFile::parameter_bytes);
                let flash = weights + MODEL_REST;
                Self { form, flash, policy: weights, maps: 0, ram: ARENA, stack: 0, instructions: None }
            }
            Form::Crazyflie => Self::of_pilot(form, (network, file_len), [APP_CODE, APP_MEMORY, APP_STACK]),
            Form::Betaflight => {
                Self::of_pilot(form, (network, file_len), [BETAFLIGHT_CODE, BETAFLIGHT_MEMORY, CORE_STACK])
            }
            Form::Rust => Self::of_pilot(form, (network, file_len), [CORE_CODE, CORE_MEMORY, CORE_STACK]),
        }
    }

    /// Flash that all of it takes \[bytes\].
    pub const fn flash(&self) -> usize {
        self.flash
    }

    /// Of exported C with a memory.
    fn of_remembering_c(policy: &RecurrentPolicy<'_>) -> Self {
        let (network, units) = (policy.network(), policy.units());
        let parameters = policy.parameter_bytes();
        Self {
            form: Form::C,
            flash: c_flash(network) - network.parameter_bytes() + parameters + C_MEMORY_CODE,
            policy: parameters,
            maps: 0,
            ram: 6 * widest(network).max(2 * units) + 2 * units,
            stack: C_STACK,
            instructions: None,
        }
    }

    /// Of a file of so many bytes and a pilot with this code, memory and stack.
    fn of_pilot(
        form: Form,
        (network, file_len): (Option<&PolicyFile<'_>>, usize),
        [code, ram, stack]: [usize; 3],
    ) -> Self {
        let instructions = network.map(tick_instructions);
        Self { form, flash: code + file_len, policy: file_len, maps: 0, ram, stack, instructions }
    }

    /// The same with maps of so many bytes.
    #[must_use]
    pub const fn with_maps(self, maps: usize) -> Self {
        Self { flash: self.flash + maps, maps, ..self }
    }
}

impl Built {
    /// Compiles the C among `written`, files and folders, for a Cortex-M4; nothing where there is none, or no compiler.
    ///
    /// # Errors
    /// [`BuildError`]: the compiler refuses it.
    pub fn of(written: &[PathBuf]) -> Result<Option<Self>, BuildError> {
        let Some(source) = written.iter().find_map(|path| c_file(path)) else { return Ok(None) };
        let object = std::env::temp_dir().join(format!("kestrel-{}.o", std::process::id()));
        let mut compiler = Command::new(COMPILER);
        compiler.args(FLAGS).arg("-c").arg(&source).arg("-o").arg(&object);
        let output = match compiler.output() {
            Ok(output) => output,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(reason) => return Err(BuildError::Run { program: COMPILER, reason }),
        };
        if !output.status.success() {
            let message = String::from_utf8_lossy(&output.stderr).into_owned();
            return Err(BuildError::Refused { path: source, message });
        }
        let sections = Command::new(SIZE).arg(&object).output();
        // What is left behind lies where such things may lie.
        let _removed = std::fs::remove_file(&object);
        let sections = match sections {
            Ok(sections) => sections,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(reason) => return Err(BuildError::Run { program: SIZE, reason }),
        };
        let text = String::from_utf8_lossy(&sections.stdout).into_owned();
        let numbers: Vec<usize> = text
            .lines()
            .nth(1)
            .map(|line| line.split_whitespace().map_while(|word| word.parse().ok()).collect())
            .unwrap_or_default();
        match numbers[..] {
            [text, data, bss, ..] => Ok(Some(Self { flash: text + data, ram: data + bss })),
            _ => Err(BuildError::Sections(text)),
        }
    }

    /// Whether it takes no more than was said, by a compiler that may be another than that of the model: to 3 %.
    pub const fn within(&self, cost: &Cost) -> bool {
        100 * self.flash <= 103 * cost.flash && self.ram <= cost.ram
    }
}

/// The C file at a path: itself, or `policy.c` in a folder.
fn c_file(path: &Path) -> Option<PathBuf> {
    let inside = path.join("policy.c");
    if path.extension().is_some_and(|extension| extension == "c") {
        Some(path.to_owned())
    } else {
        inside.exists().then_some(inside)
    }
}

/// Weights, table and code of exported C, with its golden vectors.
fn c_flash(network: &PolicyFile<'_>) -> usize {
    let metadata = network.metadata();
    let golden = 4 * network.golden_vectors().count() * (metadata.observation.len() + metadata.action.len());
    network.parameter_bytes() + golden + C_TANGENTS + C_CODE
}

/// Values of the widest layer, filled up as they are stored.
fn widest(network: &PolicyFile<'_>) -> usize {
    let values =
        network.shapes().flat_map(|(inputs, outputs)| [inputs.next_multiple_of(2), outputs.next_multiple_of(4)]);
    values.max().unwrap_or_default()
}

fn c_instructions(network: &PolicyFile<'_>) -> usize {
    let observed = network.metadata().observation.len() as f64;
    let layers = layers_instructions(network, C_PER_BLOCK, C_PER_VALUE);
    (layers + C_PER_INPUT * observed + C_ALWAYS) as usize
}

fn tick_instructions(network: &PolicyFile<'_>) -> usize {
    (layers_instructions(network, CORE_PER_BLOCK, CORE_PER_VALUE) + AROUND_NETWORK) as usize
}

fn layers_instructions(network: &PolicyFile<'_>, per_block: f64, per_value: f64) -> f64 {
    let hidden_layers = network.shapes().count().saturating_sub(1);
    let hidden: usize = network.shapes().take(hidden_layers).map(|(_, outputs)| outputs.next_multiple_of(4)).sum();
    let products: f64 = network
        .shapes()
        .map(|(inputs, outputs)| (inputs.div_ceil(2) as f64, outputs.div_ceil(4) as f64))
        .map(|(pairs, blocks)| blocks * (PER_PAIR * pairs + per_block))
        .sum();
    products + per_value * hidden as f64
}

impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { form, flash, policy, maps, ram, stack, instructions } = self;
        let [kilobytes, of_policy, of_maps, memory] = [flash, policy, maps, ram].map(|bytes| *bytes as f64 / 1e3);
        write!(f, "about {kilobytes:.1} kB of flash, {of_policy:.1} of them for the policy, ")?;
        if *maps > 0 {
            write!(f, "{of_maps:.1} for the maps of its rooms, ")?;
        }
        write!(f, "{memory:.1} kB of RAM")?;
        if *stack > 0 {
            write!(f, ", {stack} bytes of stack")?;
        }
        let Some(instructions) = instructions else { return Ok(()) };
        let call = match form {
            Form::C => "an action",
            Form::Rust | Form::Crazyflie | Form::Betaflight | Form::Px4 => "a control period",
        };
        write!(f, " and {instructions} instructions {call} of a Cortex-M4")?;
        if *maps > 0 { f.write_str(", its beams aside") } else { Ok(()) }
    }
}

impl fmt::Display for Built {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { flash, ram } = self;
        write!(f, "{COMPILER} makes {flash} bytes of flash and {ram} of RAM of the C.")
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::policy_file::Aligned;

    use super::*;

    static HOVER: Aligned<{ include_bytes!("../../../assets/pilots/hover-cf2x.kestrel").len() }> =
        Aligned(*include_bytes!("../../../assets/pilots/hover-cf2x.kestrel"));

    fn cost(form: Form) -> Cost {
        Cost::of(&Policy::parse(&HOVER.0).unwrap(), form, HOVER.0.len())
    }

    #[test]
    fn exported_c_takes_what_a_compiler_and_an_emulator_counted() {
        let Cost { flash, ram, instructions, .. } = cost(Form::C);
        // 15,820 bytes and 10,363 instructions at -Os, by gcc 12.2.
        assert!((15_820..16_000).contains(&flash), "{flash}");
        assert_eq!(ram, 6 * 64);
        assert!((10_100..10_650).contains(&instructions.unwrap()), "{instructions:?}");
    }

    #[test]
    fn a_control_period_takes_what_an_emulator_counted() {
        // 9,078 instructions.
        let Cost { instructions, .. } = cost(Form::Crazyflie);
        assert!((8_900..9_400).contains(&instructions.unwrap()), "{instructions:?}");
        // The controller for Betaflight's forks and the library in it: 26,912 bytes of flash, 3,708 of RAM.
        let Cost { flash, policy, ram, .. } = cost(Form::Betaflight);
        assert!((26_912..27_600).contains(&(flash - policy)) && (3708..4100).contains(&ram), "{flash} {ram}");
        let text = cost(Form::Rust).to_string();
        assert!(text.contains("kB of flash") && text.ends_with("a control period of a Cortex-M4"), "{text}");
    }

    #[test]
    fn what_grew_is_noticed() {
        let cost = cost(Form::C);
        let built = Built { flash: cost.flash, ram: 0 };
        assert!(built.within(&cost));
        assert!(!Built { flash: cost.flash * 104 / 100, ..built }.within(&cost));
    }
}
