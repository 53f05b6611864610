//! The same bits everywhere: digests of what every policy does with the same inputs.

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::attitude::Attitude;
use kestrel_core::effectiveness::RotorEffectiveness;
#[cfg(feature = "encoder")]
use kestrel_core::gru::HiddenState;
use kestrel_core::mlp::WIDTH_LIMIT;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{Arithmetic, PolicyAirframe, PolicyError, PolicyFile, PolicyScratch};
#[cfg(feature = "encoder")]
use kestrel_core::policy_file::{RecurrentPolicy, VisionPolicy};
use kestrel_core::vehicle::State;

use crate::autopilot;
use crate::digest::Digest;
use crate::input::Inputs;
use crate::learning;
use crate::link;
use crate::machine::{Verdict, hexadecimal, print};
use crate::policy::{Artifact, MEASURED, PILOTS};
#[cfg(feature = "encoder")]
use crate::policy::{RECURRENT, SEEING};
#[cfg(feature = "encoder")]
use crate::sight::{Sight, photograph};

/// Inputs of each policy in fixed point.
const INPUTS: u32 = 100_000;

/// Inputs of each policy in float; a machine without floating point needs half a million instructions for each.
const FLOAT_INPUTS: u32 = if cfg!(target_arch = "riscv32") { FIRST_FLOAT_INPUTS } else { INPUTS };

/// After so many inputs in float a digest is printed for comparison with machines that stop there.
const FIRST_FLOAT_INPUTS: u32 = 5_000;

/// Images that each policy with an eye sees, a control period each.
#[cfg(feature = "encoder")]
const IMAGES: u32 = 100;

/// Control periods that each policy flies.
const TICKS: u32 = 2_000;

/// Prints the digests of every policy, of learning, of frames and of flights; refused if a policy does not compute what it did when
/// it was exported, or a flight does not go as it should.
pub fn run() -> Verdict {
    let parts = learning::run().and(link::run()).and(autopilot::run());
    let policies = PILOTS.iter().chain(MEASURED).map(|artifact| check(artifact, digests(artifact)));
    #[cfg(feature = "encoder")]
    let policies = policies
        .chain(RECURRENT.iter().map(|artifact| check(artifact, recurrent_digests(artifact))))
        .chain(SEEING.iter().map(|artifact| check(artifact, seeing_digests(artifact))));
    policies.fold(parts, Verdict::and)
}

fn check(artifact: &Artifact, digests: Result<(), PolicyError>) -> Verdict {
    if digests.is_ok() {
        return Verdict::Passed;
    }
    print(&[artifact.name, ": refused\n"]);
    Verdict::Failed
}

fn digests(artifact: &Artifact) -> Result<(), PolicyError> {
    let policy = PolicyFile::parse(artifact.bytes)?;
    let mut scratch = PolicyScratch::new();
    policy.self_test_with(&mut scratch)?;
    let arithmetic = policy.arithmetic();
    line(artifact, arithmetic, "golden", golden(&policy, &mut scratch));
    let mut inputs = Inputs::new(1);
    let mut digest = Digest::new();
    match policy.arithmetic() {
        Arithmetic::Fixed16 => {
            random(&policy, INPUTS, &mut inputs, &mut digest, &mut scratch);
            line(artifact, arithmetic, "100,000 inputs", digest);
        }
        Arithmetic::Float32 => {
            random(&policy, FIRST_FLOAT_INPUTS, &mut inputs, &mut digest, &mut scratch);
            line(artifact, arithmetic, "5,000 inputs", digest);
            if FLOAT_INPUTS > FIRST_FLOAT_INPUTS {
                random(&policy, FLOAT_INPUTS - FIRST_FLOAT_INPUTS, &mut inputs, &mut digest, &mut scratch);
                line(artifact, arithmetic, "100,000 inputs", digest);
            }
        }
    }
    line(artifact, arithmetic, "2,000 ticks", ticks(&policy));
    if let Some(airframe) = &policy.metadata().airframe {
        let digest = compensated_ticks(&policy, airframe);
        line(artifact, arithmetic, "2,000 ticks with weak rotors", digest);
    }
    Ok(())
}

#[cfg(feature = "encoder")]
/// One long flight on random inputs, all of which the policy remembers.
fn recurrent_digests(artifact: &Artifact) -> Result<(), PolicyError> {
    let policy = RecurrentPolicy::parse(artifact.bytes)?;
    let (mut hidden, mut scratch) = (HiddenState::new(), PolicyScratch::new());
    policy.self_test_with(&mut hidden, &mut scratch)?;
    let (mut inputs, mut digest) = (Inputs::new(1), Digest::new());
    let mut observation = [0.0; WIDTH_LIMIT];
    let observation = observation.get_mut(..policy.metadata().observation.len()).unwrap_or_default();
    for _ in 0..FIRST_FLOAT_INPUTS {
        inputs.fill(observation);
        digest.add(&policy.act(observation, &mut hidden, &mut scratch));
    }
    line(artifact, policy.arithmetic(), "5,000 inputs", digest);
    Ok(())
}

#[cfg(feature = "encoder")]
/// One flight on random inputs and images, all of which the policy remembers.
fn seeing_digests(artifact: &Artifact) -> Result<(), PolicyError> {
    let policy = VisionPolicy::parse(artifact.bytes)?;
    let (mut sight, mut scratch) = (Sight::new(), PolicyScratch::new());
    let mut workspace = sight.workspace(policy.arithmetic());
    policy.self_test_with(&mut workspace, &mut scratch)?;
    workspace.clear();
    let (mut inputs, mut digest) = (Inputs::new(1), Digest::new());
    let mut observation = [0.0; WIDTH_LIMIT];
    let observation = observation.get_mut(..policy.metadata().observation.len()).unwrap_or_default();
    for _ in 0..IMAGES {
        policy.encode(&photograph(&mut inputs), &mut workspace)?;
        inputs.fill(observation);
        digest.add(&policy.act(observation, &mut workspace, &mut scratch)?);
    }
    line(artifact, policy.arithmetic(), "100 images", digest);
    Ok(())
}

fn line(artifact: &Artifact, arithmetic: Arithmetic, what: &str, digest: Digest) {
    let digits = hexadecimal(digest.value());
    let digits = core::str::from_utf8(&digits).unwrap_or_default();
    print(&[artifact.name, " ", arithmetic.name(), ": ", what, " ", digits, "\n"]);
}

fn golden(policy: &PolicyFile<'_>, scratch: &mut PolicyScratch) -> Digest {
    let mut digest = Digest::new();
    for (observation, _) in policy.golden_vectors() {
        digest.add(&policy.act(&observation, scratch));
    }
    digest
}

fn random(
    policy: &PolicyFile<'_>,
    count: u32,
    inputs: &mut Inputs,
    digest: &mut Digest,
    scratch: &mut PolicyScratch,
) {
    let mut observation = [0.0; WIDTH_LIMIT];
    let observation = observation.get_mut(..policy.metadata().observation.len()).unwrap_or_default();
    for _ in 0..count {
        inputs.fill(observation);
        let action: [f32; ACTION_LIMIT] = policy.act(observation, scratch);
        digest.add(&action);
    }
}

/// State in, rotor targets out; each action is in the next observation.
fn ticks(policy: &PolicyFile<'_>) -> Digest {
    let mut pilot = Pilot::new(policy.clone());
    let mut inputs = Inputs::new(2);
    let mut digest = Digest::new();
    for _ in 0..TICKS {
        let (state, goal) = (inputs.state(), inputs.vector());
        digest.add(&pilot.tick(&state, &goal));
    }
    digest
}

/// The same of a drone that flies calmly, whose rotors are learned.
fn compensated_ticks(policy: &PolicyFile<'_>, airframe: &PolicyAirframe) -> Digest {
    let mut pilot = Pilot::new(policy.clone());
    let metadata = policy.metadata();
    let (mut inputs, mut digest) = (Inputs::new(7), Digest::new());
    let (hover, limit) = (metadata.action.hover_speed_squared(), metadata.action.rotor_speed_limit());
    let mut effectiveness = RotorEffectiveness::new(airframe, hover, limit);
    for _ in 0..TICKS {
        let (tilt, goal) = (inputs.vector() * 0.1, inputs.vector());
        let state = State {
            world_from_body: Attitude { w: 1.0, x: tilt.x, y: tilt.y, z: tilt.z }.normalized(),
            velocity: inputs.vector() * 0.1,
            body_rates: inputs.vector(),
            ..inputs.state()
        };
        let targets = effectiveness.compensated(&pilot.tick(&state, &goal));
        effectiveness.learn(&state, &targets, metadata.control_period_secs);
        digest.add(&targets);
        digest.add(&effectiveness.shares());
    }
    digest
}
