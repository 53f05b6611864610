//! An identification as tables for people.

use std::fmt;

use crate::airframe_file::digits;
use crate::horizon::Horizon;
use crate::identification::{Finding, Identification, Kept, Verdict};
use crate::parameter::Parameter;

/// Steps of the horizon that the table shows.
pub(crate) const SHOWN_STEPS: [usize; 3] = [1, 10, 50];

/// Names of an identification's curves: holding the state, the airframe before, the one that was found, and that one with
/// a network beside it.
const MODELS: [&str; 4] = ["hold", "before", "identified", "with residual network"];

/// Change of an error that is told as one: less is not worth a word.
const TOLD_CHANGE: f64 = 0.02;

impl fmt::Display for Kept {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Asked => formatter.write_str("kept, as asked"),
            Self::Unseen => formatter.write_str("kept: no flight has the signals that tell it"),
            Self::Uncertain(deviation) if deviation.is_finite() => {
                write!(formatter, "kept: the flights tell it to ± {}", digits(*deviation))
            }
            Self::Uncertain(_) => formatter.write_str("kept: the flights do not tell it"),
            Self::Entangled(other) => write!(formatter, "kept: it only counts together with the {}", other.name()),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { parameter, given, value, verdict } = *self;
        let (name, unit) = (parameter.name(), parameter.unit());
        write!(formatter, "{name:<24} {:>10} {:>10}  ", digits(given), digits(value))?;
        match (verdict, self.interval()) {
            (Verdict::Told(_), Some([low, high])) => {
                write!(formatter, "{:>10} to {:<10} {unit}", digits(low), digits(high))
            }
            (Verdict::Kept(kept), _) => write!(formatter, "{kept}"),
            (Verdict::Told(_), None) => Ok(()),
        }
    }
}

impl fmt::Display for Identification {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:<24} {:>10} {:>10}  {:>17}", "", "before", "now", "95 % interval")?;
        for finding in &self.findings {
            write!(formatter, "\n{finding}")?;
        }
        for horizon in &self.horizons {
            write!(formatter, "\n\n{}", HorizonTable { horizon, models: self.models() })?;
        }
        match &self.residual {
            Some(network) => write!(formatter, "\n\n{network}\n{}", self.residual_verdict()),
            None => Ok(()),
        }
    }
}

/// Mean errors of one signal, a line each model.
pub(crate) struct HorizonTable<'a> {
    pub(crate) horizon: &'a Horizon,
    pub(crate) models: &'a [&'a str],
}

impl fmt::Display for HorizonTable<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Horizon { signal, windows, .. } = self.horizon;
        write!(formatter, "{:<28}", signal.name())?;
        for steps in SHOWN_STEPS {
            write!(formatter, " {:>9}", format!("{} ms", 10 * steps))?;
        }
        write!(formatter, "   mean error of {windows} windows that were not fitted")?;
        for (curve, model) in self.models.iter().enumerate() {
            write!(formatter, "\n  {model:<26}")?;
            for steps in SHOWN_STEPS {
                write!(formatter, " {:>9.4}", self.horizon.after(curve, steps))?;
            }
        }
        Ok(())
    }
}

impl Identification {
    /// What the airframe file does not hold: how the motors of these flights answer a command.
    pub fn thrust_curve_line(&self) -> String {
        let curve = &self.drone.thrust_curve;
        format!(
            "Rotor speed over the limit = {} + {} × command × voltage / {} V, {} ms after the command.",
            digits(curve.idle_share),
            digits(1.0 - curve.idle_share),
            digits(curve.full_volts),
            digits(1e3 * curve.delay_secs)
        )
    }

    /// Names of the curves of each horizon.
    pub fn models(&self) -> &'static [&'static str] {
        if self.residual.is_some() { &MODELS } else { &MODELS[..3] }
    }

    /// What the residual network does to the errors of what was not fitted, in sentences.
    fn residual_verdict(&self) -> String {
        let [_, some, most] = SHOWN_STEPS;
        let change = |horizon: &Horizon, steps: usize| horizon.after(3, steps) / horizon.after(2, steps) - 1.0;
        let name = |horizon: &Horizon| horizon.signal.name().split(" [").next().unwrap_or_default();
        let told = |steps: usize| {
            move |horizon: &Horizon| {
                format!("{} {:+.1} % after {} ms", name(horizon), 100.0 * change(horizon, steps), 10 * steps)
            }
        };
        if self.horizons.iter().all(|horizon| change(horizon, most) == 0.0) {
            return "It adds nothing: what it learned did not help where it had not learned.".to_owned();
        }
        let changes: Vec<String> = self.horizons.iter().map(told(most)).collect();
        let mut text =
            format!("Errors of what was not fitted, beside the identified airframe: {}.", changes.join(", "));
        let worse = |steps| self.horizons.iter().filter(move |horizon| change(horizon, steps) > TOLD_CHANGE);
        let mut listed: Vec<String> = worse(some).map(told(some)).collect();
        listed.extend(worse(most).map(told(most)));
        if !listed.is_empty() {
            text = format!("{text} It is worse in this: {}.", listed.join(", "));
        }
        if self.horizons.iter().map(|horizon| change(horizon, most)).sum::<f64>() > 0.0 {
            text.push_str(" All in all it is worse: do without it.");
        }
        text
    }

    /// Numbers that the flights tell.
    pub fn told(&self) -> impl Iterator<Item = Parameter> {
        let told = |finding: &&Finding| matches!(finding.verdict, Verdict::Told(_));
        self.findings.iter().filter(told).map(|finding| finding.parameter)
    }
}
