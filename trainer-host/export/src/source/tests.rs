//! The generated C is compiled and computes the same bits; the generated Rust holds the same file.

use std::path::Path;
use std::process::Command;

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::airframe::{Airframe, CF2P, CF2X, RotorOrder};
use kestrel_core::dynamics::Integrator;
use kestrel_core::gru::HiddenState;
use kestrel_core::nalgebra::Vector3;
use kestrel_core::observation::{MeasuredLayout, ObservationLayout, PilotMeasuredLayout};
use kestrel_core::policy_file::{
    Activation, PolicyAirframe, PolicyFile, PolicyMetadata, PolicyScratch, RecurrentPolicy,
};
use kestrel_sim::physics::Physics;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::{Purpose, Seed, Stream};
use kestrel_sim::sensor::instrument::{Bias, Instrument, Noise, Sampling};
use kestrel_sim::sensor::signal::{Direction, Signal};
use kestrel_sim::sensor::{Coverage, Scan, ScanRing, SensorSuite, Told};
use kestrel_sim::world::{Movable, Pose, Shape, Solid};

use super::*;
use crate::recurrent::{RecurrentActor, export_recurrent};
use crate::tests::METADATA;
use crate::{DenseLayer, export};

/// Feeds 100,000 random observations, of which one value in sixteen is any bit pattern, then 12,000 of which half the values are
/// special, and prints the FNV-1a digest of the actions.
const DRIVER: &str = r#"
#include <stdio.h>
#include <string.h>
#include "policy.h"

static uint64_t state;

static uint64_t next(void) {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return state >> 32;
}

/* Not a number (quiet, signalling), infinite, subnormal, zero, huge, about as large as the limit of the network's inputs. */
static uint32_t special(uint32_t kind, uint32_t bits) {
    switch (kind) {
        case 0: return (bits & 0x803fffffu) | 0x7fc00000u;
        case 1: return (bits & 0x803fffffu) | 0x7f800001u;
        case 2: return (bits & 0x80000000u) | 0x7f800000u;
        case 3: return bits & 0x807fffffu;
        case 4: return bits & 0x80000000u;
        case 5: return (bits & 0x80ffffffu) | 0x7e000000u;
        default: return (bits & 0x83ffffffu) | 0x40000000u;
    }
}

int main(void) {
    static kestrel_scratch scratch;
    uint64_t digest = 0xcbf29ce484222325ull;
    int failed = kestrel_self_test(&scratch);
    for (int input = 0; input < 112000; input++) {
        float observation[KESTREL_OBSERVATION_LEN], action[KESTREL_ACTION_LEN];
        for (int index = 0; index < KESTREL_OBSERVATION_LEN; index++) {
            uint32_t bits = (uint32_t)next();
            observation[index] = (float)((int32_t)bits >> 8) / 4194304.0f;
            uint32_t choice = (uint32_t)next();
            uint32_t other = input < 100000 ? bits : special(choice / 16 % 7, bits);
            if (choice % 16 == 0 || (input >= 100000 && choice % 2 == 0)) memcpy(&observation[index], &other, sizeof other);
        }
        kestrel_act(observation, &scratch, action);
        unsigned char bytes[sizeof action];
        memcpy(bytes, action, sizeof action);
        for (unsigned index = 0; index < sizeof action; index++) digest = (digest ^ bytes[index]) * 0x100000001b3ull;
    }
    printf("%d %016llx\n", failed, (unsigned long long)digest);
    return 0;
}
"#;

/// As the driver's.
fn special(kind: u32, bits: u32) -> u32 {
    match kind {
        0 => (bits & 0x803f_ffff) | 0x7fc0_0000,
        1 => (bits & 0x803f_ffff) | 0x7f80_0001,
        2 => (bits & 0x8000_0000) | 0x7f80_0000,
        3 => bits & 0x807f_ffff,
        4 => bits & 0x8000_0000,
        5 => (bits & 0x80ff_ffff) | 0x7e00_0000,
        _ => (bits & 0x83ff_ffff) | 0x4000_0000,
    }
}

/// What the driver prints, by the core.
fn expected(policy: &PolicyFile<'_>) -> String {
    let mut scratch = policy.scratch();
    digest(policy.metadata(), |observation| policy.act(observation, &mut scratch))
}

/// The same of whatever acts.
fn digest(metadata: &PolicyMetadata<'_>, mut act: impl FnMut(&[f32]) -> [f32; ACTION_LIMIT]) -> String {
    let mut state = 0_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 32
    };
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    for input in 0..112_000 {
        let observation: Vec<f32> = (0..metadata.observation.len())
            .map(|_| {
                let bits = next() as u32;
                let usual = (bits as i32 >> 8) as f32 / 4_194_304.0;
                let choice = next() as u32;
                match input {
                    0..100_000 if choice.is_multiple_of(16) => f32::from_bits(bits),
                    100_000.. if choice.is_multiple_of(2) => f32::from_bits(special(choice / 16 % 7, bits)),
                    _ => usual,
                }
            })
            .collect();
        let action = act(&observation);
        for byte in action[..metadata.action.len()].iter().flat_map(|value| value.to_le_bytes()) {
            digest = (digest ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
    format!("0 {digest:016x}\n")
}

fn pilot(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/pilots").join(name);
    std::fs::read(path).unwrap()
}

/// What firmwares compile with. With `-ffast-math` every comparison is one of finite numbers, and subnormal numbers are zero.
const OPTIMISATIONS: [&[&str]; 12] = [
    &["-std=c99", "-O0"],
    &["-std=c99", "-O1"],
    &["-std=c99", "-O2"],
    &["-std=c99", "-O3"],
    &["-std=c99", "-Os"],
    &["-std=c99", "-O0", "-ffast-math"],
    &["-std=c99", "-O1", "-ffast-math"],
    &["-std=c99", "-O2", "-ffast-math"],
    &["-std=c99", "-O3", "-ffast-math"],
    &["-std=c99", "-Os", "-ffast-math"],
    &["-xc++", "-O2"],
    &["-xc++", "-Os", "-ffast-math"],
];

/// What every C of ours compiles with.
const STRICT: [&str; 5] = ["-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"];

/// The driver's output when the C of `policy` is compiled so, without a warning.
fn printed(policy: &CSource, optimisation: &[&str]) -> String {
    printed_by(DRIVER, policy, optimisation)
}

/// The same of another driver.
fn printed_by(driver: &str, policy: &CSource, optimisation: &[&str]) -> String {
    let place = tempfile::tempdir().unwrap();
    let files = [("policy.h", policy.header.as_str()), ("policy.c", &policy.source), ("main.c", driver)];
    for (file, text) in files {
        std::fs::write(place.path().join(file), text).unwrap();
    }
    compiled(place.path(), &[optimisation, &STRICT, &["-c", "policy.c"]].concat());
    compiled(place.path(), &[optimisation, &["-c", "main.c"]].concat());
    compiled(place.path(), &[&optimisation[1..], &["main.o", "policy.o", "-o", "main"]].concat());
    let output = Command::new(place.path().join("main")).output().unwrap();
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the compiler in `place`.
fn compiled(place: &Path, arguments: &[&str]) {
    let output = Command::new("cc").args(arguments).current_dir(place).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_c_of_every_pilot_computes_the_same_bits() {
    for name in ["hover.kestrel", "cross.kestrel"] {
        let bytes = pilot(name);
        let policy = c_source(&bytes).unwrap();
        let expected = expected(&PolicyFile::parse(&bytes).unwrap());
        for optimisation in OPTIMISATIONS {
            assert_eq!(printed(&policy, optimisation), expected, "{name} with {optimisation:?}");
        }
        assert_eq!(c_source(&bytes).unwrap(), policy, "the same bytes again");
    }
}

#[test]
fn rectifiers_in_c_compute_the_same_bits() {
    let mut stream = Stream::new(Seed(5), 0, Purpose::Weights);
    let mut normals = |count: usize, gain: f32| (0..count).map(|_| gain * stream.normal()).collect::<Vec<f32>>();
    let (first, second) = (normals(22 * 17, 2.0), normals(17 * 4, 0.1));
    let layers = [
        DenseLayer { inputs: 22, outputs: 17, weights: &first, bias: &[0.1; 17], activation: Activation::Relu },
        DenseLayer { inputs: 17, outputs: 4, weights: &second, bias: &[0.0; 4], activation: Activation::Relu },
    ];
    let bytes = export(&layers, &METADATA, &normals(22 * 8, 1.0)).unwrap().fixed_policy;
    let policy = c_source(&bytes).unwrap();
    assert!(!policy.source.contains("TANGENTS"));
    let expected = expected(&PolicyFile::parse(&bytes).unwrap());
    for optimisation in [OPTIMISATIONS[3], OPTIMISATIONS[9], OPTIMISATIONS[11]] {
        assert_eq!(printed(&policy, optimisation), expected, "{optimisation:?}");
    }
    assert!(crazyflie_app(&bytes, &[]).unwrap_err().to_string().contains("found a policy with rectifiers"));
}

#[test]
fn a_memory_in_c_computes_the_same_bits() {
    let mut stream = Stream::new(Seed(6), 0, Purpose::Weights);
    let mut normals = |count: usize, gain: f32| (0..count).map(|_| gain * stream.normal()).collect::<Vec<f32>>();
    for units in [4, 12] {
        let inputs = 22 + units;
        let [gates, candidate, hidden, output] =
            [(inputs * 2 * units, 0.5), (inputs * units, 0.5), (inputs * 9, 0.4), (9 * 4, 0.3)]
                .map(|(count, gain)| normals(count, gain));
        let layer = |inputs, outputs, weights, bias| DenseLayer {
            inputs,
            outputs,
            weights,
            bias,
            activation: Activation::Tanh,
        };
        let (zeros, small) = ([0.0; 24], [0.05; 24]);
        let layers = [layer(inputs, 9, &hidden, &small[..9]), layer(9, 4, &output, &zeros[..4])];
        let actor = RecurrentActor {
            gates: layer(inputs, 2 * units, &gates, &small[..2 * units]),
            candidate: layer(inputs, units, &candidate, &zeros[..units]),
            layers: &layers,
        };
        let bytes = export_recurrent(&actor, &METADATA, &normals(22 * 40, 1.0)).unwrap().fixed_policy;
        let policy = c_source(&bytes).unwrap();
        assert!(policy.header.contains(&format!("#define KESTREL_UNITS {units}")));
        let (parsed, mut memory) = (RecurrentPolicy::parse(&bytes).unwrap(), HiddenState::new());
        let mut scratch = PolicyScratch::new();
        let expected = digest(parsed.metadata(), |observation| parsed.act(observation, &mut memory, &mut scratch));
        let driver = DRIVER
            .replace("kestrel_scratch scratch;", "kestrel_scratch scratch; static kestrel_memory memory;")
            .replace("&scratch, action", "&scratch, &memory, action");
        for optimisation in OPTIMISATIONS {
            assert_eq!(printed_by(&driver, &policy, optimisation), expected, "{units} units, {optimisation:?}");
        }
        let app = crazyflie_app(&bytes, &[]).unwrap();
        assert!(
            app.iter().any(|(name, text)| *name == "Kbuild" && text.contains("KESTREL_FEATURES ?= ,recurrent\n"))
        );
        let refusal = betaflight_controller(&bytes).unwrap_err().to_string();
        assert!(refusal.starts_with("found a policy with a memory, expected one without"), "{refusal}");
    }
}

#[test]
fn the_rust_module_holds_the_file() {
    let bytes = pilot("hover.kestrel");
    let module = rust_module(&bytes).unwrap();
    let (_, numbers) = module.split_once("Aligned([").unwrap();
    let held: Vec<u8> =
        numbers.trim_end_matches("]);\n").split(',').filter_map(|word| word.trim().parse().ok()).collect();
    assert_eq!(held, bytes);
    assert!(
        module.contains(&format!("Aligned<{}>", bytes.len()))
            && module.contains("The policy \"hover\" in fixed16")
    );
}

#[test]
fn what_is_no_policy_has_no_source() {
    let mut bytes = pilot("hover.kestrel");
    bytes[1000] ^= 1;
    assert!(matches!(rust_module(&bytes), Err(SourceError::Policy(_))));
    assert!(matches!(c_source(&bytes), Err(SourceError::Policy(_))));
}

#[test]
fn a_name_cannot_end_a_comment() {
    assert_eq!(comment("a */ b\nc"), "a __ b_c");
}

#[test]
fn the_crazyflies_app_compiles_and_holds_the_same_file() {
    let bytes = pilot("hover.kestrel");
    let files = crazyflie_app(&bytes, &[]).unwrap();
    let place = tempfile::tempdir().unwrap();
    for (name, text) in &files {
        std::fs::write(place.path().join(name), text).unwrap();
    }
    let names: Vec<&str> = files.iter().map(|(name, _)| *name).collect();
    assert_eq!(
        names,
        [
            "kestrel_controller.c",
            "Kbuild",
            "Makefile",
            "app-config",
            "kestrel.h",
            "kestrel_guard.h",
            "policy.h",
            "policy.c"
        ]
    );
    let (_, source) = files.last().unwrap();
    let words = source.split([' ', ',', '\n']).filter_map(|word| word.strip_prefix("0x"));
    let written: Vec<u8> = words.map(|word| u8::from_str_radix(word, 16).unwrap()).collect();
    assert!(written == bytes);
    let firmware = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/firmware/crazyflie");
    for name in ["kestrel_controller.c", "policy.c"] {
        let mut compiler = Command::new("cc");
        compiler.args(["-std=gnu11", "-Wall", "-Wextra", "-Werror", "-c", name, "-I.", "-I"]).arg(&firmware);
        let compiled = compiler.current_dir(&place).output().unwrap();
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    }
}

#[test]
fn the_controller_of_betaflights_forks_is_strict_c_and_c_plus_plus() {
    let files = betaflight_controller(&pilot("hover.kestrel")).unwrap();
    let place = tempfile::tempdir().unwrap();
    for (name, text) in &files {
        std::fs::write(place.path().join(name), text).unwrap();
    }
    for language in ["-std=c99", "-xc++"] {
        for optimisation in ["-Os", "-O2", "-ffast-math"] {
            for name in ["nn_controller.c", "policy.c"] {
                compiled(place.path(), &[&[language, optimisation][..], &STRICT, &["-c", name]].concat());
            }
        }
    }
    assert!(files.iter().any(|(name, text)| *name == "policy.h" && text.contains("--target betaflight")));
}

/// Seven ticks of 4 ms that hold for 10 ms, then a set-point that grows old.
const GUARDED: &str = r#"
#include <stdio.h>
#include "kestrel_guard.h"

int main(void) {
    KestrelGuard guard = {10000, 500000, 0, 0, 0};
    const int32_t codes[] = {104, 0, 104, 0, 104, 104, 104, 104, 0, 104};
    for (unsigned index = 0; index < sizeof codes / sizeof codes[0]; index++) {
        const KestrelVerdict verdict = kestrel_guard(&guard, codes[index], 0, 4000);
        printf("%d:%d ", (int)guard.code, (int)verdict);
    }
    const KestrelVerdict verdict = kestrel_guard(&guard, 0, 500000, 4000);
    printf("%d:%d\n", (int)guard.code, (int)verdict);
    return 0;
}
"#;

#[test]
fn one_refused_tick_is_held_and_several_hand_over() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("kestrel_guard.h"), GUARD).unwrap();
    std::fs::write(place.path().join("main.c"), GUARDED).unwrap();
    for language in ["-std=c99", "-xc++"] {
        compiled(
            place.path(),
            &[&[language, "-Os", "-ffast-math"][..], &STRICT, &["main.c", "-o", "main"]].concat(),
        );
        let output = Command::new(place.path().join("main")).output().unwrap();
        // Nothing flew yet; then 0: another controller, 1: held, 2: flies.
        let expected = "104:0 0:2 104:1 0:2 104:1 104:1 104:1 104:0 0:2 104:1 120:0\n";
        assert_eq!(String::from_utf8(output.stdout).unwrap(), expected);
    }
}

#[test]
fn a_policy_with_other_sensors_or_without_a_goal_gets_no_app() {
    let weights = [0.01; 22 * 4];
    let layer =
        DenseLayer { inputs: 22, outputs: 4, weights: &weights, bias: &[0.0; 4], activation: Activation::Tanh };
    let observation = ObservationLayout::Measured(MeasuredLayout { len: 22 });
    let metadata = PolicyMetadata { observation, ..METADATA };
    let policy = export(&[layer], &metadata, &[0.5; 44]).unwrap().fixed_policy;
    let error = crazyflie_app(&policy, &[]).unwrap_err().to_string();
    assert!(error.contains("found a policy that sees `measured`, expected one trained with `pilot`"), "{error}");
}

/// Hover beside a wall and a pillar, seen by rangers and by a scan of four beams.
fn seen() -> Scenario {
    let mut scenario = Scenario::hover(&CF2X, Physics::clean(Integrator::SemiImplicitEuler, 2, 100.0));
    scenario.aviary.world.solids = vec![
        Solid::block("wall", Vector3::new(1.0, -2.0, 0.0), Vector3::new(1.1, 2.0, 2.0)),
        Solid {
            shape: Shape::Cylinder { radius: 0.1, half_height: 1.0 },
            pose: Pose::at(Vector3::new(0.0, 0.5, 1.0)),
            ..Solid::block("pillar", Vector3::zeros(), Vector3::zeros())
        },
    ];
    let ranger = |direction| Instrument {
        signal: Signal::Distance { direction, limit: 4.0 },
        noise: Noise::Constant(0.0),
        bias: Bias { constant: 0.0, walk: 0.0 },
        limits: [0.0, 4.0],
        resolution: 0.001,
        sampling: Sampling { rate_hz: 10.0, latency_secs: 0.0, drop_out: 0.0 },
        unit: 1.0,
    };
    let scan =
        Scan { rings: vec![ScanRing { elevation: 0.0, beams: 4 }], limit: 2.0, near_scale: None, sweeps: false };
    let rangers = [Direction::Front, Direction::Down].map(ranger).to_vec();
    scenario.sensors = SensorSuite::new(rangers, 0.02).with_scan(Some(scan));
    scenario
}

/// Of a policy that sees so many values of sensors.
fn seeing(measured_len: u8) -> Vec<u8> {
    let inputs = 22 + usize::from(measured_len);
    let weights = vec![0.01; inputs * 4];
    let layer =
        DenseLayer { inputs, outputs: 4, weights: &weights, bias: &[0.0; 4], activation: Activation::Tanh };
    let ObservationLayout::Pilot(scales) = METADATA.observation else { panic!("the layout is `pilot`") };
    let observation = ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales, measured_len });
    let metadata = PolicyMetadata { observation, ..METADATA };
    export(&[layer], &metadata, &vec![0.5; 2 * inputs]).unwrap().fixed_policy
}

#[test]
fn the_crazyflies_app_has_the_rangers_and_the_maps_of_what_a_policy_sees() {
    let (bytes, scenario) = (seeing(6), seen());
    let mut empty = scenario.clone();
    empty.aviary.world.solids.clear();
    let files = crazyflie_app(&bytes, &[("wall", &scenario), ("none", &empty)]).unwrap();
    let [.., (_, header), (_, source)] = files.as_slice() else { panic!("files") };
    for line in [
        "#define KESTREL_MEASUREMENTS 6",
        "#define KESTREL_RANGERS 2",
        "#define KESTREL_RANGER_NAMES \"front\", \"zrange\"",
        "#define KESTREL_RANGER_LIMITS 4.0f, 4.0f",
        " *     1 none",
        "#define KESTREL_ROOMS 2",
    ] {
        assert!(header.lines().any(|found| found == line), "{line}:\n{header}");
    }
    assert!(source.contains("\nstatic const KestrelSlab SLABS_0[16] = {"), "{source}");
    assert!(source.contains(", 0, SLABS_1, 0, BODIES_1},"), "{source}");
    let place = tempfile::tempdir().unwrap();
    for (name, text) in &files {
        std::fs::write(place.path().join(name), text).unwrap();
    }
    let firmware = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/firmware/crazyflie");
    for (name, language) in
        [("kestrel_controller.c", "-std=gnu11"), ("policy.c", "-std=c99"), ("policy.c", "-xc++")]
    {
        let mut compiler = Command::new("cc");
        compiler.args([language, "-Wall", "-Wextra", "-Werror", "-c", name, "-I.", "-I"]).arg(&firmware);
        let compiled = compiler.current_dir(&place).output().unwrap();
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    }
}

#[test]
fn what_a_crazyflie_does_not_measure_gets_no_app() {
    let refusal = |bytes: &[u8], tasks: &[(&str, &Scenario)]| crazyflie_app(bytes, tasks).unwrap_err().to_string();
    let scenario = seen();
    let unknown = refusal(&seeing(6), &[]);
    assert!(unknown.starts_with("found a policy file alone"), "{unknown}");
    let other = refusal(&seeing(7), &[("wall", &scenario)]);
    assert!(other.contains("sees 7 values, where its task measures 6,"), "{other}");
    let mut moving = scenario.clone();
    let solid = scenario.aviary.world.solids[0].clone();
    moving.aviary.world.movables = vec![Movable::pushed(solid, 1.0)];
    let moves = refusal(&seeing(6), &[("wall", &scenario), ("push", &moving)]);
    assert!(moves.contains("a scan of what moves (push)"), "{moves}");
    let mut differing = scenario.clone();
    differing.sensors = SensorSuite::none();
    let differs = refusal(&seeing(6), &[("wall", &scenario), ("blind", &differing)]);
    assert!(differs.contains("the sensors of wall otherwise in blind"), "{differs}");
    let mut turning = scenario.clone();
    let gyroscope = Instrument { signal: Signal::BodyRates, ..scenario.sensors.instruments()[0] };
    turning.sensors = SensorSuite::new(vec![gyroscope], 0.02);
    let turns = refusal(&seeing(3), &[("turn", &turning)]);
    assert!(turns.contains("found a policy that sees a gyroscope, expected rangers"), "{turns}");
    let mut told = scenario.clone();
    told.sensors = SensorSuite::none().with_told(Some(Told::Coverage(Coverage { cells: 2, next_scale_m: None })));
    let cells = refusal(&seeing(4), &[("field", &told)]);
    assert!(cells.contains("found a policy that sees which cells it has visited, expected rangers"), "{cells}");
    let mut sweeping = scenario.clone();
    sweeping.sensors = scenario
        .sensors
        .clone()
        .with_scan(Some(Scan { sweeps: true, ..scenario.sensors.scan().unwrap().clone() }));
    let sweeps = refusal(&seeing(6), &[("wall", &sweeping)]);
    assert!(sweeps.contains("found a policy that sees beams that sweep, expected rangers"), "{sweeps}");
    let forks = betaflight_controller(&seeing(6)).unwrap_err().to_string();
    assert!(forks.contains("found a policy that sees `pilot_measured`"), "{forks}");
}

#[test]
fn a_policy_for_rotors_in_another_order_gets_no_app() {
    let weights = [0.01; 22 * 4];
    let layer =
        DenseLayer { inputs: 22, outputs: 4, weights: &weights, bias: &[0.0; 4], activation: Activation::Tanh };
    let app = |airframe: &Airframe| {
        let metadata = PolicyMetadata { airframe: Some(PolicyAirframe::from(airframe)), ..METADATA };
        let policy = export(&[layer], &metadata, &[0.5; 44]).unwrap().fixed_policy;
        let header = c_source(&policy).unwrap().header;
        assert!(header.contains("#define KESTREL_MASS_KG 0.027f\n"), "{header}");
        crazyflie_app(&policy, &[]).map(|_| ())
    };
    assert_eq!(app(&CF2X), Ok(()));
    for other in [CF2X.numbered(RotorOrder::CounterClockwise), CF2P] {
        assert_eq!(app(&other), Err(SourceError::Rotors));
    }
}
