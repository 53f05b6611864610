//! Which parts of the flights are not fitted.

use std::str::FromStr;

use crate::course::Course;
use crate::error::LogError;
use crate::flight::Flight;

/// What is kept for the report.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum HoldOut {
    /// The last quarter of each flight.
    #[default]
    LastQuarter,
    /// These flights, or stretches of them.
    Spans(Vec<Span>),
}

/// A flight, or a stretch of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// How the name of its file ends or what it contains.
    pub name: String,
    /// First and last time stamp \[s\]; the whole flight without.
    pub secs: Option<[f64; 2]>,
}

impl FromStr for Span {
    type Err = String;

    /// `NAME` or `NAME:FROM-TO`.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "expected NAME or NAME:FROM-TO in seconds, such as log15:75-90".to_owned();
        let Some((name, span)) = text.rsplit_once(':') else {
            return if text.is_empty() { Err(wrong()) } else { Ok(Self { name: text.to_owned(), secs: None }) };
        };
        let (from, to) = span.split_once('-').ok_or_else(wrong)?;
        let number = |text: &str| text.parse::<f64>().map_err(|_| wrong());
        let secs = [number(from)?, number(to)?];
        if name.is_empty() || secs[0].is_nan() || secs[0] >= secs[1] {
            return Err(wrong());
        }
        Ok(Self { name: name.to_owned(), secs: Some(secs) })
    }
}

impl HoldOut {
    /// The flights, each with its rows that are held out.
    pub(crate) fn courses<'a>(&self, flights: &'a [Flight]) -> Result<Vec<Course<'a>>, LogError> {
        if let Self::Spans(spans) = self
            && let Some(span) =
                spans.iter().find(|span| !flights.iter().any(|flight| flight.name.contains(&span.name)))
        {
            let names: Vec<&str> = flights.iter().map(|flight| flight.name.as_str()).collect();
            return Err(LogError::at(
                "--hold-out",
                format!("`{}`", span.name),
                format!("one of {}", names.join(", ")),
            ));
        }
        Ok(flights.iter().map(|flight| Course::new(flight, self.rows(flight))).collect())
    }

    fn rows(&self, flight: &Flight) -> Vec<bool> {
        match self {
            Self::LastQuarter => {
                let flying = |row: &usize| flight.commands[*row].iter().any(|command| *command > 0.0);
                let rows: Vec<usize> = (0..flight.rows()).filter(flying).collect();
                let first = rows.get(rows.len() * 3 / 4).copied().unwrap_or(flight.rows());
                (0..flight.rows()).map(|row| row >= first).collect()
            }
            Self::Spans(spans) => {
                let within =
                    |secs: f64| move |span: &Span| span.secs.is_none_or(|[from, to]| secs >= from && secs <= to);
                let mine: Vec<&Span> = spans.iter().filter(|span| flight.name.contains(&span.name)).collect();
                let held = |row: usize| mine.iter().any(|span| within(flight.time_secs(row))(span));
                (0..flight.rows()).map(held).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_is_a_name_with_or_without_seconds() {
        assert_eq!("log15:75-90.5".parse(), Ok(Span { name: "log15".to_owned(), secs: Some([75.0, 90.5]) }));
        assert_eq!("B2_circle".parse(), Ok(Span { name: "B2_circle".to_owned(), secs: None }));
        for wrong in ["", ":1-2", "a:2-1", "a:b-c", "a:1"] {
            assert!(wrong.parse::<Span>().is_err(), "{wrong}");
        }
    }
}
