//! Marks on paper, before they become SVG or pixels.

/// Red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colour(pub(super) [u8; 3]);

/// A picture of flat marks, in order from the lowest to the topmost; x to the right, y down \[px\].
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) marks: Vec<Mark>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Mark {
    Polygon { corners: Vec<[f64; 2]>, fill: Option<(Colour, f64)>, edge: Option<Pen> },
    Line { ends: [[f64; 2]; 2], pen: Pen },
    Disc { centre: [f64; 2], radius: f64, fill: Option<(Colour, f64)>, edge: Option<Pen> },
    Text(Text),
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pen {
    pub(super) colour: Colour,
    /// \[px\].
    pub(super) width: f64,
    pub(super) dashed: Dashed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dashed {
    Solid,
    Dashes,
}

/// One line of words.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Text {
    /// Where its baseline is.
    pub(super) at: [f64; 2],
    pub(super) words: String,
    /// Height of the letters with their descenders \[px\].
    pub(super) size: f64,
    pub(super) colour: Colour,
    pub(super) anchor: Anchor,
}

/// Which point of a text is where it is put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Pen {
    pub(super) const fn solid(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashed: Dashed::Solid }
    }

    pub(super) const fn dashes(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashed: Dashed::Dashes }
    }
}

impl Drawing {
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self { width, height, marks: Vec::new() }
    }

    /// Makes it at least this high \[px\].
    pub(super) fn extend_to(&mut self, height: f64) {
        self.height = self.height.max(height);
    }

    pub(super) fn polygon(&mut self, corners: Vec<[f64; 2]>, fill: Option<(Colour, f64)>, edge: Option<Pen>) {
        self.marks.push(Mark::Polygon { corners, fill, edge });
    }

    pub(super) fn line(&mut self, ends: [[f64; 2]; 2], pen: Pen) {
        self.marks.push(Mark::Line { ends, pen });
    }

    pub(super) fn disc(&mut self, centre: [f64; 2], radius: f64, fill: Option<(Colour, f64)>, edge: Option<Pen>) {
        self.marks.push(Mark::Disc { centre, radius, fill, edge });
    }

    pub(super) fn text(&mut self, text: Text) {
        self.marks.push(Mark::Text(text));
    }
}
