//! A policy on an emulated microcontroller, behind a serial line.

mod comparison;

use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use kestrel_core::observation::ObservationLayout;
use kestrel_core::policy_file::PolicyFile;
use kestrel_core::processor_in_the_loop::{MessageHeader, MessageKind, NO_POLICY, SerialPort, send, tick_payload};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_shim::policy_backend::PolicyBackend;
use thiserror::Error;

pub(crate) use comparison::compare;

/// The emulator, and the board whose processor is the Crazyflie's.
const EMULATOR: &str = "qemu-system-arm";
const BOARD: &str = "netduinoplus2";

/// An answer takes milliseconds; a machine that is busy with other things may take its time.
const PATIENCE: Duration = Duration::from_secs(20);

/// Bytes that are passed on at once.
const BURST: usize = 4096;

/// Most bytes of an answer's payload.
const ANSWER_LIMIT: usize = 16;

/// What computes a policy's ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum ProcessorKind {
    /// This machine
    #[default]
    Host,
    /// The Crazyflie's STM32F405, emulated by QEMU, behind a serial line
    Qemu,
}

/// Options of commands that can have a policy computed elsewhere.
#[derive(Clone, Debug, Default, PartialEq, Eq, clap::Args)]
pub(crate) struct ProcessorOptions {
    /// What computes the policy
    #[arg(long, value_enum, default_value_t = ProcessorKind::Host)]
    pub(crate) processor: ProcessorKind,

    /// Image of the program `pilot`, for an emulated processor
    #[arg(long, value_name = "FILE", default_value = "target/thumbv7em-none-eabihf/firmware/pilot")]
    pub(crate) image: PathBuf,
}

/// Why there is no processor.
#[derive(Debug, Error)]
pub(crate) enum ProcessorError {
    /// There is no image to run.
    #[error(
        "cannot read the image {}: {reason}; build it with `RUSTFLAGS=\"-C target-cpu=cortex-m4\" cargo build -p kestrel-image --profile firmware --target thumbv7em-none-eabihf --bin pilot --features assembly,serial`",
        path.display()
    )]
    Image {
        /// Where it was looked for.
        path: PathBuf,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// The emulator does not start.
    #[error("cannot start {EMULATOR}: {0}; on Debian it is in the package qemu-system-arm")]
    Emulator(io::Error),
    /// The processor says nothing, or nothing that makes sense.
    #[error("the processor does not answer: is {} an image of the program `pilot`?", path.display())]
    Silent {
        /// The image.
        path: PathBuf,
    },
    /// One processor flies one drone.
    #[error("found a task with {found} drones, expected one: a processor flies one")]
    Team {
        /// Drones of the task.
        found: u32,
    },
    /// The processor refuses the policy.
    #[error("the processor refuses the policy with code {code}")]
    Refused {
        /// See [`kestrel_core::policy_file::PolicyError::code`] and [`kestrel_core::processor_in_the_loop`].
        code: i32,
    },
}

/// An emulated processor with a policy in its memory.
#[derive(Debug)]
pub(crate) struct Qemu {
    line: QueuePort,
    control_secs: f32,
    observation: ObservationLayout,
}

/// A serial line to a child process, which ends with it.
#[derive(Debug)]
struct QueuePort {
    process: Child,
    outgoing: BufWriter<ChildStdin>,
    incoming: Receiver<Vec<u8>>,
    burst: std::vec::IntoIter<u8>,
}

/// What the other side said.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Answer {
    Code(i32),
    Targets([f32; 4]),
}

impl Qemu {
    /// Starts the emulator with an image of the program `pilot`, and sends the policy in `file`.
    ///
    /// # Errors
    /// When image or emulator are missing, nobody answers, or the policy is refused there.
    pub(crate) fn start(image: &Path, file: &[u8], policy: &PolicyFile<'_>) -> Result<Self, ProcessorError> {
        std::fs::File::open(image).map_err(|reason| ProcessorError::Image { path: image.to_owned(), reason })?;
        let silent = || ProcessorError::Silent { path: image.to_owned() };
        let mut line = QueuePort::open(image)?;
        // What is sent before the line is open there would be lost.
        if line.answer() != Some(Answer::Code(NO_POLICY)) {
            return Err(silent());
        }
        match line.ask(MessageKind::Policy, &[file]) {
            Some(Answer::Code(0)) => {}
            Some(Answer::Code(code)) => return Err(ProcessorError::Refused { code }),
            Some(Answer::Targets(_)) | None => return Err(silent()),
        }
        let metadata = policy.metadata();
        Ok(Self { line, control_secs: metadata.control_period_secs, observation: metadata.observation })
    }

    /// As [`kestrel_core::pilot::Pilot::tick_towards`], over there; nothing when nobody answers.
    pub(crate) fn tick_towards(
        &mut self,
        measurements: &[f32],
        state: &State<f32>,
        setpoint: &Setpoint<f32>,
    ) -> Option<[f32; 4]> {
        let numbers = tick_payload(state, setpoint);
        let measurements: Vec<u8> = measurements.iter().flat_map(|value| value.to_le_bytes()).collect();
        match self.line.ask(MessageKind::Tick, &[numbers.as_flattened(), &measurements])? {
            Answer::Targets(targets) => Some(targets),
            Answer::Code(_) => None,
        }
    }
}

impl PolicyBackend for Qemu {
    fn control_secs(&self) -> f32 {
        self.control_secs
    }

    fn observation(&self) -> &ObservationLayout {
        &self.observation
    }

    fn healthy(&mut self) -> bool {
        self.line.ask(MessageKind::Test, &[]) == Some(Answer::Code(0))
    }

    fn reset(&mut self) {
        // Who does not hear it does not answer the next tick either.
        let _heard = self.line.ask(MessageKind::Reset, &[]);
    }

    fn tick(&mut self, state: &State<f32>, setpoint: &Setpoint<f32>) -> Option<[f32; 4]> {
        self.tick_towards(&[], state, setpoint)
    }
}

impl QueuePort {
    fn open(image: &Path) -> Result<Self, ProcessorError> {
        let mut command = Command::new(EMULATOR);
        command
            .args(["-M", BOARD, "-display", "none", "-monitor", "none", "-serial", "stdio", "-kernel"])
            .arg(image);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut process = command.spawn().map_err(ProcessorError::Emulator)?;
        let missing = || ProcessorError::Emulator(io::ErrorKind::BrokenPipe.into());
        let outgoing = BufWriter::new(process.stdin.take().ok_or_else(missing)?);
        let mut output = BufReader::new(process.stdout.take().ok_or_else(missing)?);
        let (sender, incoming) = channel();
        thread::spawn(move || {
            let mut room = [0; BURST];
            while let Ok(len @ 1..) = output.read(&mut room) {
                if sender.send(room[..len].to_vec()).is_err() {
                    return;
                }
            }
        });
        Ok(Self { process, outgoing, incoming, burst: Vec::new().into_iter() })
    }

    fn ask(&mut self, kind: MessageKind, payload: &[&[u8]]) -> Option<Answer> {
        send(self, kind, payload);
        self.outgoing.flush().ok()?;
        self.answer()
    }

    fn answer(&mut self) -> Option<Answer> {
        let mut room = [0; ANSWER_LIMIT];
        let head = MessageHeader::receive(self)?;
        let payload = head.receive_payload(self, &mut room)?.ok()?;
        match (head.kind()?, payload.as_chunks::<4>()) {
            (MessageKind::Code, ([code], [])) => Some(Answer::Code(i32::from_le_bytes(*code))),
            (MessageKind::Targets, ([a, b, c, d], [])) => {
                Some(Answer::Targets([*a, *b, *c, *d].map(f32::from_le_bytes)))
            }
            (
                MessageKind::Code
                | MessageKind::Targets
                | MessageKind::Policy
                | MessageKind::Reset
                | MessageKind::Tick
                | MessageKind::Test,
                _,
            ) => None,
        }
    }
}

impl SerialPort for QueuePort {
    fn read(&mut self) -> Option<u8> {
        if let Some(byte) = self.burst.next() {
            return Some(byte);
        }
        match self.incoming.recv_timeout(PATIENCE) {
            Ok(burst) => {
                self.burst = burst.into_iter();
                self.burst.next()
            }
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => None,
        }
    }

    fn write(&mut self, byte: u8) {
        // A line that is gone is noticed by the answer that does not come.
        let _written = self.outgoing.write_all(&[byte]);
    }
}

impl Drop for QueuePort {
    fn drop(&mut self) {
        // Either may fail only when the process has ended by itself.
        let _killed = self.process.kill();
        let _waited = self.process.wait();
    }
}
