//! Results for programs, in place of the words for people.

use std::fmt::Display;

use anyhow::Result;
use kestrel_experiments::output::say;
use serde::Serialize;

/// Whether results are wanted as JSON.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Json {
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

impl Json {
    /// Prints what was found, for one of both readers.
    pub(super) fn tell(self, words: impl Display, found: &impl Serialize) -> Result<()> {
        if self.json {
            return Ok(say(serde_json::to_string_pretty(found)?)?);
        }
        Ok(say(words)?)
    }

    /// As [`Self::tell`], one of many, in a line.
    pub(super) fn tell_line(self, words: impl Display, found: &impl Serialize) -> Result<()> {
        if self.json {
            return Ok(say(serde_json::to_string(found)?)?);
        }
        Ok(say(words)?)
    }

    /// Prints what only people want to read.
    pub(super) fn add(self, words: impl Display) -> Result<()> {
        if self.json { Ok(()) } else { Ok(say(words)?) }
    }
}
