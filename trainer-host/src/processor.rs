//! A policy on another processor, behind a serial line: an emulated microcontroller, or a program of this machine that brings an
//! autopilot's own interface.

mod comparison;

use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use kestrel_core::observation::ObservationLayout;
use kestrel_core::policy_file::PolicyMetadata;
use kestrel_core::processor_in_the_loop::{MessageHeader, MessageKind, NO_POLICY, SerialPort, send, tick_payload};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_shim::policy_backend::PolicyBackend;
use thiserror::Error;

pub(crate) use comparison::{Judged, compare, fly_beside};

/// The emulator, and the board whose processor is the Crazyflie's.
const EMULATOR: &str = "qemu-system-arm";
const BOARD: &str = "netduinoplus2";

/// Where `cargo build` puts the program `pilot`.
const PILOT_IMAGE: &str = "target/thumbv7em-none-eabihf/firmware/pilot";

/// An answer takes milliseconds; a machine that is busy with other things may take its time.
const PATIENCE: Duration = Duration::from_secs(20);

/// Between the last byte of a program and its end.
const ENDING_LIMIT: Duration = Duration::from_secs(1);

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
    /// A program of this machine that speaks the same protocol on its standard input and output
    Program,
}

/// Options of commands that can have a policy computed elsewhere.
#[derive(Clone, Debug, Default, PartialEq, Eq, clap::Args)]
pub(crate) struct ProcessorOptions {
    /// What computes the policy
    #[arg(long, value_enum, default_value_t = ProcessorKind::Host)]
    pub(crate) processor: ProcessorKind,

    /// Image of the program `pilot` for an emulated processor [default:
    /// target/thumbv7em-none-eabihf/firmware/pilot], or the program of this machine
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

impl ProcessorOptions {
    /// What computes the policy, if this machine's pilot does not.
    ///
    /// # Errors
    /// When a program is wanted, but none is named.
    pub(crate) fn remote(&self) -> Result<Option<RemoteKind<'_>>, ProcessorError> {
        let image = self.image.as_deref();
        Ok(match self.processor {
            ProcessorKind::Host => None,
            ProcessorKind::Qemu => Some(RemoteKind::Qemu(image.unwrap_or(Path::new(PILOT_IMAGE)))),
            ProcessorKind::Program => Some(RemoteKind::Program(image.ok_or(ProcessorError::Unnamed)?)),
        })
    }
}

/// Another processor, with what runs there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RemoteKind<'a> {
    /// An emulated microcontroller, with its image.
    Qemu(&'a Path),
    /// A program of this machine.
    Program(&'a Path),
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
    /// A program is wanted, but none is named.
    #[error("found --processor program alone, expected the program too: --image FILE")]
    Unnamed,
    /// The program does not start.
    #[error("cannot start {}: {reason}; expected a program of this machine that may be executed", path.display())]
    Program {
        /// The program.
        path: PathBuf,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// The program is over.
    #[error("{} ended before it was told to, with {status}", path.display())]
    Ended {
        /// What ran.
        path: PathBuf,
        /// How it ended.
        status: ExitStatus,
    },
    /// The emulated processor says nothing, or nothing that makes sense.
    #[error("the processor does not answer: is {} an image of the program `pilot`?", path.display())]
    Silent {
        /// The image.
        path: PathBuf,
    },
    /// The program says nothing, or nothing that makes sense.
    #[error(
        "{} does not answer within {} s: expected the processor-in-the-loop protocol on its standard input and output",
        path.display(), PATIENCE.as_secs()
    )]
    SilentProgram {
        /// The program.
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
    /// The processor refuses to fly on.
    #[error("the processor refuses a control period with code {code}")]
    RefusedTick {
        /// Of the program's own.
        code: i32,
    },
    /// The processor's answer is none that motors could follow.
    #[error("the processor asks for rotor speeds of {found:?} rad/s, expected finite numbers")]
    Targets {
        /// What it asks for \[rad/s\].
        found: [f32; 4],
    },
}

/// Another processor with a policy in its memory.
#[derive(Debug)]
pub(crate) struct RemoteProcessor {
    line: QueuePort,
    path: PathBuf,
    emulated: bool,
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
    connected: bool,
}

/// What the other side said.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Answer {
    Code(i32),
    Targets([f32; 4]),
}

impl RemoteKind<'_> {
    /// As the option has it.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Qemu(_) => "qemu",
            Self::Program(_) => "program",
        }
    }

    /// The process that is the processor.
    fn start(self) -> Result<QueuePort, ProcessorError> {
        match self {
            Self::Qemu(image) => {
                std::fs::File::open(image)
                    .map_err(|reason| ProcessorError::Image { path: image.to_owned(), reason })?;
                let mut command = Command::new(EMULATOR);
                command
                    .args(["-M", BOARD, "-display", "none", "-monitor", "none", "-serial", "stdio", "-kernel"])
                    .arg(image)
                    .stderr(Stdio::null());
                QueuePort::open(&mut command).map_err(ProcessorError::Emulator)
            }
            // A name alone would be looked for among the commands of the system.
            Self::Program(path) => std::path::absolute(path)
                .and_then(|program| QueuePort::open(&mut Command::new(program)))
                .map_err(|reason| ProcessorError::Program { path: path.to_owned(), reason }),
        }
    }
}

impl RemoteProcessor {
    /// Starts a processor, and sends the policy in `file`, of which `metadata` are.
    ///
    /// # Errors
    /// When image, emulator or program are missing, nobody answers, or the policy is refused there.
    pub(crate) fn start(
        kind: RemoteKind<'_>,
        file: &[u8],
        metadata: &PolicyMetadata<'_>,
    ) -> Result<Self, ProcessorError> {
        let (path, emulated) = match kind {
            RemoteKind::Qemu(image) => (image, true),
            RemoteKind::Program(program) => (program, false),
        };
        let mut remote = Self {
            line: kind.start()?,
            path: path.to_owned(),
            emulated,
            control_secs: metadata.control_period_secs,
            observation: metadata.observation,
        };
        // What is sent before the line is open there would be lost.
        if remote.line.answer() != Some(Answer::Code(NO_POLICY)) {
            return Err(remote.failure());
        }
        match remote.line.ask(MessageKind::Policy, &[file]) {
            Some(Answer::Code(0)) => Ok(remote),
            Some(Answer::Code(code)) => Err(ProcessorError::Refused { code }),
            Some(Answer::Targets(_)) | None => Err(remote.failure()),
        }
    }

    /// As [`kestrel_core::pilot::Pilot::tick_towards`], over there.
    ///
    /// # Errors
    /// When nobody answers, the state is refused, or the answer is not finite.
    pub(crate) fn tick_towards(
        &mut self,
        measurements: &[f32],
        state: &State<f32>,
        setpoint: &Setpoint<f32>,
    ) -> Result<[f32; 4], ProcessorError> {
        let numbers = tick_payload(state, setpoint);
        let measurements: Vec<u8> = measurements.iter().flat_map(|value| value.to_le_bytes()).collect();
        match self.line.ask(MessageKind::Tick, &[numbers.as_flattened(), &measurements]) {
            Some(Answer::Targets(targets)) if targets.iter().all(|target| target.is_finite()) => Ok(targets),
            Some(Answer::Targets(found)) => Err(ProcessorError::Targets { found }),
            Some(Answer::Code(code)) => Err(ProcessorError::RefusedTick { code }),
            None => Err(self.failure()),
        }
    }

    /// Why there was no answer.
    fn failure(&mut self) -> ProcessorError {
        let path = self.path.clone();
        match self.line.status() {
            Some(status) => ProcessorError::Ended { path, status },
            None if self.emulated => ProcessorError::Silent { path },
            None => ProcessorError::SilentProgram { path },
        }
    }
}

impl PolicyBackend for RemoteProcessor {
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
        self.tick_towards(&[], state, setpoint).ok()
    }
}

impl QueuePort {
    fn open(command: &mut Command) -> io::Result<Self> {
        let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let missing = || io::Error::from(io::ErrorKind::BrokenPipe);
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
        Ok(Self { process, outgoing, incoming, burst: Vec::new().into_iter(), connected: true })
    }

    /// How the process ended, if it did.
    fn status(&mut self) -> Option<ExitStatus> {
        let mut waited = Duration::ZERO;
        loop {
            let status = self.process.try_wait().ok().flatten();
            if status.is_some() || self.connected || waited >= ENDING_LIMIT {
                return status;
            }
            let pause = Duration::from_millis(10);
            thread::sleep(pause);
            waited += pause;
        }
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
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                self.connected = false;
                None
            }
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
