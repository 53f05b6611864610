//! What a control period costs: each part runs between two marks that a counter of instructions sees, on a painted stack.
//!
//! Prints a line for each window, its name and the bytes of stack below the call, and one with the bytes of a pilot; the
//! windows are the odd ones of the counter's. `tests/firmware/budget.py` joins the two.

use core::hint::black_box;

use kestrel_core::airframe::CF2X;
use kestrel_core::anchor::fixed::{FixedAnchor, Fraction, ProximalShares};
use kestrel_core::attitude::Attitude;
use kestrel_core::effectiveness::RotorEffectiveness;
use kestrel_core::fixed::{FixedScratch, OutputLearner};
#[cfg(feature = "encoder")]
use kestrel_core::gru::HiddenState;
use kestrel_core::mlp::WIDTH_LIMIT;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{PolicyAirframe, PolicyError, PolicyFile, PolicyScratch};
#[cfg(feature = "encoder")]
use kestrel_core::policy_file::{RecurrentPolicy, VisionPolicy};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::input::Inputs;
use crate::learning::OUTPUT_PARAMETERS;
use crate::machine::{Verdict, decimal, print};
use crate::policy::{Artifact, MEASURED, NETWORK, PILOTS};
#[cfg(feature = "encoder")]
use crate::policy::{RECURRENT, SEEING};
use crate::probe::{mark, stack_below};
#[cfg(feature = "encoder")]
use crate::sight::{Sight, photograph};

/// Inputs per part: the greatest count is reported, because a few branches depend on them.
const REPETITIONS: usize = 16;

/// Runs every part in its window.
pub fn run() -> Verdict {
    line("pilot-bytes", "pilot", size_of::<Pilot<'static>>() as u32);
    line("pilot-bytes", "effectiveness", size_of::<RotorEffectiveness>() as u32);
    window("nothing", "at-all", || {});
    let steps = MEASURED.iter().map(step);
    let ticks = PILOTS.iter().map(tick);
    let learning = core::iter::once_with(learn).chain(core::iter::once_with(compensate));
    #[cfg(feature = "encoder")]
    let learning = learning.chain(RECURRENT.iter().map(recurrent_step)).chain(SEEING.iter().map(look));
    if steps.chain(ticks).chain(learning).all(|result| result.is_ok()) { Verdict::Passed } else { Verdict::Failed }
}

/// One step of an output layer, and the pull of its anchor.
fn learn() -> Result<(), PolicyError> {
    let network = NETWORK.network()?;
    let (mut memory, mut center) = ([0; OUTPUT_PARAMETERS], [0; OUTPUT_PARAMETERS]);
    let mut importance = [100; OUTPUT_PARAMETERS];
    let Some(mut learner) = OutputLearner::new(&network, &mut memory) else { return Ok(()) };
    let shares = ProximalShares::at(Fraction::nearest(0.05));
    let mut scratch = FixedScratch::new();
    let features = network.features(&[0.5; 16], &mut scratch);
    for call in 0..REPETITIONS as u32 {
        window("learn", "fixed16", || {
            black_box(learner.learn(black_box(features), &[0.1, -0.2, 0.3, -0.4], Fraction::nearest(0.1)));
        });
        window("pull", "fixed16", || {
            if let Ok(parameters) = learner.parameters_mut().try_into() {
                let parameters: &mut [i16; OUTPUT_PARAMETERS] = parameters;
                let anchor = FixedAnchor { center: &mut center, importance: &mut importance };
                anchor.proximal_step(parameters, &shares, call);
            }
        });
    }
    Ok(())
}

/// What makes up for weak rotors in a control period: a step of learning, and the targets that follow from it.
fn compensate() -> Result<(), PolicyError> {
    let [hover, limit] = [CF2X.hover_rotor_speed(), CF2X.rotor_speed_limit].map(|speed| speed as f32);
    let mut effectiveness = RotorEffectiveness::new(&PolicyAirframe::from(&CF2X), hover * hover, limit);
    let mut inputs = Inputs::new(8);
    for _ in 0..REPETITIONS {
        let calm =
            State { world_from_body: Attitude::level(), body_rates: Vector3::zeros(), ..flying(&mut inputs) };
        window("compensate", "float32", || {
            let targets = effectiveness.compensated(black_box(&[hover; 4]));
            effectiveness.learn(black_box(&calm), &targets, 0.01);
        });
    }
    Ok(())
}

/// One inference.
fn step(artifact: &Artifact) -> Result<(), PolicyError> {
    let policy = PolicyFile::parse(artifact.bytes)?;
    let mut scratch = PolicyScratch::new();
    let mut inputs = Inputs::new(3);
    let mut observation = [0.0; WIDTH_LIMIT];
    let observation = observation.get_mut(..policy.metadata().observation.len()).unwrap_or_default();
    for _ in 0..REPETITIONS {
        inputs.fill_usual(observation);
        window("step", policy.arithmetic().name(), || {
            black_box(policy.act(black_box(observation), &mut scratch));
        });
    }
    window("self-test", policy.arithmetic().name(), || {
        let _ = black_box(policy.self_test_with(&mut scratch));
    });
    window("parse", policy.arithmetic().name(), || {
        let _ = black_box(PolicyFile::parse(black_box(artifact.bytes)));
    });
    Ok(())
}

#[cfg(feature = "encoder")]
/// One inference of a policy that remembers.
fn recurrent_step(artifact: &Artifact) -> Result<(), PolicyError> {
    let policy = RecurrentPolicy::parse(artifact.bytes)?;
    let (mut hidden, mut scratch) = (HiddenState::new(), PolicyScratch::new());
    let mut inputs = Inputs::new(5);
    let mut observation = [0.0; WIDTH_LIMIT];
    let observation = observation.get_mut(..policy.metadata().observation.len()).unwrap_or_default();
    for _ in 0..REPETITIONS {
        inputs.fill_usual(observation);
        window("recurrent-step", policy.arithmetic().name(), || {
            black_box(policy.act(black_box(observation), &mut hidden, &mut scratch));
        });
    }
    Ok(())
}

#[cfg(feature = "encoder")]
/// One image, and one inference of a policy that sees and remembers.
fn look(artifact: &Artifact) -> Result<(), PolicyError> {
    let policy = VisionPolicy::parse(artifact.bytes)?;
    let (arithmetic, mut sight, mut scratch) = (policy.arithmetic(), Sight::new(), PolicyScratch::new());
    let mut workspace = sight.workspace(arithmetic);
    workspace.clear();
    let mut inputs = Inputs::new(6);
    let mut observation = [0.0; WIDTH_LIMIT];
    let observation = observation.get_mut(..policy.metadata().observation.len()).unwrap_or_default();
    for _ in 0..REPETITIONS {
        let image = photograph(&mut inputs);
        window("image", arithmetic.name(), || {
            let _ = black_box(policy.encode(black_box(&image), &mut workspace));
        });
        inputs.fill_usual(observation);
        window("seeing-step", arithmetic.name(), || {
            let _ = black_box(policy.act(black_box(observation), &mut workspace, &mut scratch));
        });
    }
    Ok(())
}

/// State in, rotor targets out.
fn tick(artifact: &Artifact) -> Result<(), PolicyError> {
    let mut pilot = Pilot::new(PolicyFile::parse(artifact.bytes)?);
    let arithmetic = pilot.policy().arithmetic().name();
    let mut inputs = Inputs::new(4);
    for _ in 0..REPETITIONS {
        let (state, goal) = (flying(&mut inputs), Vector3::new(0.0, 0.0, 1.0));
        window("tick", arithmetic, || {
            black_box(pilot.tick(black_box(&state), black_box(&goal)));
        });
    }
    Ok(())
}

/// A state in the midst of a flight: within ±2 m, m/s, rad/s, at any attitude.
fn flying(inputs: &mut Inputs) -> State<f32> {
    let mut values = [0.0; 13];
    inputs.fill_usual(&mut values);
    let [x, y, z, qw, qx, qy, qz, vx, vy, vz, p, q, r] = values;
    State {
        position: Vector3::new(x, y, z),
        world_from_body: Attitude { w: qw, x: qx, y: qy, z: qz }.normalized(),
        velocity: Vector3::new(vx, vy, vz),
        body_rates: Vector3::new(p, q, r),
        rotor_speeds: [0.0; 4],
    }
}

fn window(part: &str, arithmetic: &str, mut work: impl FnMut()) {
    let stack = stack_below(&mut || {
        mark();
        work();
        mark();
    });
    line(part, arithmetic, stack);
}

fn line(part: &str, of: &str, bytes: u32) {
    let digits = decimal(bytes);
    print(&[part, " ", of, " ", core::str::from_utf8(&digits).unwrap_or_default(), "\n"]);
}
