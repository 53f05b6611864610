//! The generated C is compiled and computes the same bits; the generated Rust holds the same file.

use std::path::Path;
use std::process::Command;

use kestrel_core::observation::{MeasuredLayout, ObservationLayout};
use kestrel_core::policy_file::{Activation, PolicyFile, PolicyMetadata};

use super::*;
use crate::tests::METADATA;
use crate::{DenseLayer, export};

/// Feeds random observations, of which one value in sixteen is any bit pattern, and prints the FNV-1a digest of the actions.
const DRIVER: &str = r#"
#include <stdio.h>
#include <string.h>
#include "policy.h"

static uint64_t state;

static uint64_t next(void) {
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return state >> 32;
}

int main(void) {
    static kestrel_scratch scratch;
    uint64_t digest = 0xcbf29ce484222325ull;
    int failed = kestrel_self_test(&scratch);
    for (int input = 0; input < 100000; input++) {
        float observation[KESTREL_OBSERVATION_LEN], action[KESTREL_ACTION_LEN];
        for (int index = 0; index < KESTREL_OBSERVATION_LEN; index++) {
            uint32_t bits = (uint32_t)next();
            observation[index] = (float)((int32_t)bits >> 8) / 4194304.0f;
            if (next() % 16 == 0) memcpy(&observation[index], &bits, sizeof bits);
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

/// What the driver prints, by the core.
fn expected(policy: &PolicyFile<'_>) -> String {
    let mut state = 0_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 32
    };
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    let mut scratch = policy.scratch();
    for _ in 0..100_000 {
        let observation: Vec<f32> = (0..policy.metadata().observation.len())
            .map(|_| {
                let bits = next() as u32;
                let usual = (bits as i32 >> 8) as f32 / 4_194_304.0;
                if next() % 16 == 0 { f32::from_bits(bits) } else { usual }
            })
            .collect();
        let action = policy.act(&observation, &mut scratch);
        for byte in action[..policy.metadata().action.len()].iter().flat_map(|value| value.to_le_bytes()) {
            digest = (digest ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
    format!("0 {digest:016x}\n")
}

fn pilot(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/pilots").join(name);
    std::fs::read(path).unwrap()
}

/// What firmwares compile with; with `-ffast-math` every comparison is one of finite numbers.
const OPTIMISATIONS: [&[&str]; 6] = [&["-O0"], &["-O1"], &["-O2"], &["-O3"], &["-Os"], &["-Os", "-ffast-math"]];

/// The driver's output when the C of `policy` is compiled so, without a warning.
fn printed(policy: &CSource, optimisation: &[&str]) -> String {
    let place = tempfile::tempdir().unwrap();
    let driver = DRIVER.to_owned();
    for (file, text) in [("policy.h", &policy.header), ("policy.c", &policy.source), ("main.c", &driver)] {
        std::fs::write(place.path().join(file), text).unwrap();
    }
    let cc = |arguments: &[&str]| {
        let compiled = Command::new("cc").arg("-std=c99").args(arguments).current_dir(&place).output().unwrap();
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    };
    let strict = ["-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-c", "policy.c"];
    cc(&[optimisation, &strict].concat());
    cc(&["-O2", "main.c", "policy.o", "-o", "main"]);
    let output = Command::new(place.path().join("main")).output().unwrap();
    String::from_utf8(output.stdout).unwrap()
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
    let files = crazyflie_app(&bytes).unwrap();
    let place = tempfile::tempdir().unwrap();
    for (name, text) in &files {
        std::fs::write(place.path().join(name), text).unwrap();
    }
    let names: Vec<&str> = files.iter().map(|(name, _)| *name).collect();
    assert_eq!(
        names,
        ["kestrel_controller.c", "Kbuild", "Makefile", "app-config", "kestrel.h", "policy.h", "policy.c"]
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
fn a_policy_with_other_sensors_or_without_a_goal_gets_no_app() {
    let weights = [0.01; 22 * 4];
    let layer =
        DenseLayer { inputs: 22, outputs: 4, weights: &weights, bias: &[0.0; 4], activation: Activation::Tanh };
    let observation = ObservationLayout::Measured(MeasuredLayout { len: 22 });
    let metadata = PolicyMetadata { observation, ..METADATA };
    let policy = export(&[layer], &metadata, &[0.5; 44]).unwrap().fixed_policy;
    let error = crazyflie_app(&policy).unwrap_err().to_string();
    assert!(error.contains("found a policy that sees `measured`, expected one trained with `pilot`"), "{error}");
}
