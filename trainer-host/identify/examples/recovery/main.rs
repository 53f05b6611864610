//! How often `identify`'s 95 % intervals hold the numbers of a drone that is known: `recovery 100`, or
//! `recovery 100 speeds` where rotor speeds are measured, late and noisy, instead of the commands.

mod simulated;

use std::collections::BTreeMap;
use std::process::ExitCode;

use kestrel_identify::{IdentifyError, Parameter};
use simulated::{Case, Recorded};

fn main() -> ExitCode {
    let cases = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(100);
    let recorded = match std::env::args().nth(2).as_deref() {
        Some("speeds") => Recorded::Speeds,
        Some(_) | None => Recorded::Commands,
    };
    match table(cases, recorded) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn table(cases: u64, recorded: Recorded) -> Result<(), IdentifyError> {
    // Told, held, and the sum of relative errors, of each number.
    let mut rows: BTreeMap<Parameter, (usize, usize, f64)> = BTreeMap::new();
    for seed in 0..cases {
        let case = Case::run(seed, recorded)?;
        for (finding, held) in case.told() {
            let (told, right, error) = rows.entry(finding.parameter).or_default();
            let truth = finding.parameter.value(&case.truth);
            *told += 1;
            *right += usize::from(held);
            *error += (finding.value / truth - 1.0).abs();
        }
    }
    println!("{:<24} {:>6} {:>8} {:>12}", "", "told", "held", "mean error");
    let (mut all, mut all_right) = (0, 0);
    for (parameter, (told, right, error)) in rows {
        println!("{:<24} {told:>6} {right:>8} {:>10.2} %", parameter.name(), 100.0 * error / told as f64);
        all += told;
        all_right += right;
    }
    println!(
        "{:<24} {all:>6} {all_right:>8}   {:.1} % of the intervals hold",
        "",
        100.0 * all_right as f64 / all as f64
    );
    Ok(())
}
