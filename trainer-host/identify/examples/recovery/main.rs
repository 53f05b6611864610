//! How often `identify`'s 95 % intervals hold the numbers of a drone that is known: `recovery 100`, or
//! `recovery 100 speeds` where rotor speeds are measured, late and noisy, instead of the commands. `recovery 20 residual`
//! says what a residual network does to the errors of drones that the model describes, and of drones that it does not.

mod simulated;

use std::collections::BTreeMap;
use std::process::ExitCode;

use kestrel_identify::horizon::Signal;
use kestrel_identify::{IdentifyError, Parameter};
use rayon::prelude::*;
use simulated::{Case, Recorded, Unmodelled};

fn main() -> ExitCode {
    let cases = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(100);
    let printed = match std::env::args().nth(2).as_deref() {
        Some("residual") => changes(cases),
        Some("speeds") => table(cases, Recorded::Speeds),
        Some(_) | None => table(cases, Recorded::Commands),
    };
    match printed {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn changes(cases: u64) -> Result<(), IdentifyError> {
    println!("{:<10} {:<28} {:>8} {:>8} {:>8}   error after 500 ms, % more", "", "", "least", "median", "most");
    for unmodelled in [Unmodelled::Nothing, Unmodelled::Air] {
        let cases: Vec<Case> = (0..cases)
            .into_par_iter()
            .map(|seed| Case::with_residual(seed, unmodelled))
            .collect::<Result<_, _>>()?;
        for signal in Signal::GIVEN {
            let of_signal = |case: &Case| case.changes().into_iter().find(|(of, _)| *of == signal);
            let mut changes: Vec<f64> =
                cases.iter().filter_map(of_signal).map(|(_, change)| 100.0 * change).collect();
            changes.sort_by(f64::total_cmp);
            let [least, median, most] = [0, changes.len() / 2, changes.len() - 1].map(|index| changes[index]);
            let lacking = format!("{unmodelled:?}");
            println!("{lacking:<10} {:<28} {least:>8.1} {median:>8.1} {most:>8.1}", signal.name());
        }
    }
    Ok(())
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
