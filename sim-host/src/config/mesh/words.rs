//! Texts of words, where each knows its place.

use super::{Fault, TextPosition};

/// A word of a text.
#[derive(Clone, Copy, Debug)]
pub(super) struct Word<'a> {
    pub(super) text: &'a str,
    pub(super) position: TextPosition,
}

/// The words of a line \[counted from one\], without what follows a `#`.
pub(super) fn words(number: usize, line: &str) -> impl Iterator<Item = Word<'_>> {
    let line = line.split_once('#').map_or(line, |(before, _)| before);
    line.split_whitespace().map(move |text| {
        let column = text.as_ptr() as usize - line.as_ptr() as usize + 1;
        Word { text, position: TextPosition { line: number, column } }
    })
}

/// The position behind the last line of a text.
pub(super) fn end(text: &str) -> TextPosition {
    TextPosition { line: text.lines().count().max(1), column: 1 }
}

impl Word<'_> {
    pub(super) fn refuse(&self, expected: impl Into<String>) -> Fault {
        Fault::new(self.position, format!("`{}`", self.text), expected)
    }

    /// A coordinate or the part of a colour.
    pub(super) fn number(&self) -> Result<f64, Fault> {
        let number = self.text.parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| self.refuse("a finite number"))
    }
}

/// Three numbers, the first of the words behind the one that says what they are.
pub(super) fn three(what: &Word<'_>, words: &[Word<'_>]) -> Result<[f64; 3], Fault> {
    let [x, y, z, ..] = words else {
        let found = format!("{} numbers behind `{}`", words.len(), what.text);
        return Err(Fault::new(what.position, found, "three"));
    };
    Ok([x.number()?, y.number()?, z.number()?])
}
