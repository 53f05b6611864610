//! `kestrel test`.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, ensure};
use kestrel_experiments::atomic_file::{FileError, write_atomically};
use kestrel_experiments::interrupt::Interrupt;
use serde_json::{Value, json};

use super::Done;
use super::json::Json;
use crate::flight_test::case::Case;
use crate::flight_test::runner::{RunOptions, Verdict, run};
use crate::flight_test::{config, junit};
use crate::shipped;

/// Arguments of `kestrel test`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Files of flights, such as configs/tests/hover.yaml, or names of shipped ones: hover
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,

    /// Replace a value of every file, such as pilot=cascade (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Only flights in whose names this occurs
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,

    /// Write the results as `JUnit` XML
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,

    /// Write a film (GIF) of every flight that fails into this directory
    #[arg(long, value_name = "DIRECTORY")]
    films: Option<PathBuf>,

    #[command(flatten)]
    json: Json,
}

pub(crate) fn run_tests(arguments: &Arguments) -> Result<Done> {
    let cases = arguments.cases()?;
    if let Some(folder) = &arguments.films {
        fs::create_dir_all(folder).map_err(|cause| FileError::new("create", folder, cause))?;
    }
    let interrupt = Interrupt::watch("Stopping after the flights in progress; Ctrl-C again ends at once.")?;
    let options = RunOptions { threads: rayon::current_num_threads(), films: arguments.films.clone() };
    let begun = Instant::now();
    let Some(verdicts) = run(&cases, &options, &interrupt)? else { return Ok(Done::Interrupted) };
    let wall_secs = begun.elapsed().as_secs_f64();
    if let Some(path) = &arguments.junit {
        write_atomically(path, junit::report(&verdicts).as_bytes())?;
    }
    let failed = verdicts.iter().filter(|verdict| !verdict.failures.is_empty()).count();
    let secs: f64 = verdicts.iter().map(|verdict| verdict.secs).sum();
    let passed = verdicts.len() - failed;
    let lines: String = verdicts.iter().map(lines).collect();
    let words = format!("{lines}{passed} passed, {failed} failed: {secs:.0} s of flight in {wall_secs:.1} s");
    arguments.json.tell(words, &verdicts.iter().map(found).collect::<Vec<_>>())?;
    Ok(if failed == 0 { Done::Finished } else { Done::Deviating })
}

impl Arguments {
    fn cases(&self) -> Result<Vec<Case>> {
        let mut cases = Vec::new();
        for path in &self.files {
            cases.extend(config::load(&shipped::configuration("tests", path)?, &self.set)?);
        }
        let mut names = BTreeSet::new();
        for case in &cases {
            let name = case.full_name();
            ensure!(
                names.insert(name.clone()),
                "found the flight {name} twice, expected files of different names"
            );
        }
        if let Some(text) = &self.only {
            cases.retain(|case| case.full_name().contains(text.as_str()));
            ensure!(!cases.is_empty(), "found --only {text}, expected a part of a flight's name");
        }
        Ok(cases)
    }
}

/// A line for every flight, and one for everything that came of it instead of what was expected.
fn lines(verdict: &Verdict) -> String {
    let Verdict { suite, name, hash, failures, heard, .. } = verdict;
    let result = if failures.is_empty() { "passed" } else { "FAILED" };
    let failed = failures.iter().map(|failure| format!("        {failure}\n"));
    let heard = heard.iter().map(|words| format!("        the vehicle said at {words}\n"));
    let heard = heard.filter(|_| !failures.is_empty());
    format!("{result}  {hash:016x}  {suite}/{name}\n{}", failed.chain(heard).collect::<String>())
}

/// The same for programs.
fn found(verdict: &Verdict) -> Value {
    let Verdict { suite, name, secs, hash, failures, heard } = verdict;
    let failures: Vec<String> = failures.iter().map(ToString::to_string).collect();
    json!({ "suite": suite, "name": name, "secs": secs, "hash": format!("{hash:016x}"), "failures": failures, "heard": heard })
}
