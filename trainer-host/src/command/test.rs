//! `kestrel test`.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, ensure};
use kestrel_experiments::atomic_file::{FileError, write_atomically};
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::output::say;

use super::Done;
use super::study::threads;
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

    /// Threads to use; the results do not depend on it [default: all cores]
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run_tests(arguments: &Arguments) -> Result<Done> {
    let cases = arguments.cases()?;
    if let Some(folder) = &arguments.films {
        fs::create_dir_all(folder).map_err(|cause| FileError::new("create", folder, cause))?;
    }
    let interrupt = Interrupt::watch("Stopping after the flights in progress; Ctrl-C again ends at once.")?;
    let options = RunOptions { threads: threads(arguments.threads), films: arguments.films.clone() };
    let begun = Instant::now();
    let Some(verdicts) = run(&cases, &options, &interrupt)? else { return Ok(Done::Interrupted) };
    let wall_secs = begun.elapsed().as_secs_f64();
    if let Some(path) = &arguments.junit {
        write_atomically(path, junit::report(&verdicts).as_bytes())?;
    }
    verdicts.iter().try_for_each(tell)?;
    let failed = verdicts.iter().filter(|verdict| !verdict.failures.is_empty()).count();
    let secs: f64 = verdicts.iter().map(|verdict| verdict.secs).sum();
    let passed = verdicts.len() - failed;
    say(format_args!("{passed} passed, {failed} failed: {secs:.0} s of flight in {wall_secs:.1} s"))?;
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
fn tell(verdict: &Verdict) -> Result<()> {
    let Verdict { suite, name, hash, failures, heard, .. } = verdict;
    let result = if failures.is_empty() { "passed" } else { "FAILED" };
    say(format_args!("{result}  {hash:016x}  {suite}/{name}"))?;
    for failure in failures {
        say(format_args!("        {failure}"))?;
    }
    if !failures.is_empty() {
        heard.iter().try_for_each(|words| say(format_args!("        the vehicle said at {words}")))?;
    }
    Ok(())
}
