//! Flat pictures: marks on paper, which become SVG or pixels.

mod png;
mod svg;

pub use png::{PngError, png_of_pixels};

/// Red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub [u8; 3]);

/// A picture of flat marks, in order from the lowest to the topmost; x to the right, y down \[px\].
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// \[px\].
    pub width: f64,
    /// \[px\].
    pub height: f64,
    pub(crate) marks: Vec<Mark>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Mark {
    Polygon {
        corners: Vec<[f64; 2]>,
        fill: Option<(Colour, f64)>,
        edge: Option<Pen>,
    },
    Line {
        ends: [[f64; 2]; 2],
        pen: Pen,
    },
    /// An open line through several points.
    Path {
        points: Vec<[f64; 2]>,
        pen: Pen,
    },
    Disc {
        centre: [f64; 2],
        radius: f64,
        fill: Option<(Colour, f64)>,
        edge: Option<Pen>,
    },
    Text(Text),
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pen {
    /// Of the line.
    pub colour: Colour,
    /// \[px\].
    pub width: f64,
    /// Whether it has gaps.
    pub dashed: Dashed,
}

/// Whether a line has gaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dashed {
    /// None.
    Solid,
    /// Four pixels, then a gap of three.
    Dashes,
}

/// One line of words.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Where its baseline is.
    pub at: [f64; 2],
    /// What it says.
    pub words: String,
    /// Height of the letters with their descenders \[px\].
    pub size: f64,
    /// Of the letters.
    pub colour: Colour,
    /// Which point of it is at `at`.
    pub anchor: Anchor,
}

/// Which point of a text is where it is put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Where it begins.
    Start,
    /// Half way.
    Middle,
    /// Where it ends.
    End,
}

impl Pen {
    /// A line without gaps.
    pub const fn solid(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashed: Dashed::Solid }
    }

    /// A line with gaps.
    pub const fn dashes(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashed: Dashed::Dashes }
    }
}

impl Drawing {
    /// Empty paper \[px\].
    pub fn new(width: f64, height: f64) -> Self {
        Self { width, height, marks: Vec::new() }
    }

    /// Makes it at least this high \[px\].
    pub fn extend_to(&mut self, height: f64) {
        self.height = self.height.max(height);
    }

    /// A closed shape, filled with a colour of an opacity in \[0, 1\], or with an edge, or both.
    pub fn polygon(&mut self, corners: Vec<[f64; 2]>, fill: Option<(Colour, f64)>, edge: Option<Pen>) {
        self.marks.push(Mark::Polygon { corners, fill, edge });
    }

    /// A straight line.
    pub fn line(&mut self, ends: [[f64; 2]; 2], pen: Pen) {
        self.marks.push(Mark::Line { ends, pen });
    }

    /// A line through several points.
    pub fn path(&mut self, points: Vec<[f64; 2]>, pen: Pen) {
        self.marks.push(Mark::Path { points, pen });
    }

    /// A disc; fill and edge as those of [`Self::polygon`].
    pub fn disc(&mut self, centre: [f64; 2], radius: f64, fill: Option<(Colour, f64)>, edge: Option<Pen>) {
        self.marks.push(Mark::Disc { centre, radius, fill, edge });
    }

    /// A line of words.
    pub fn text(&mut self, text: Text) {
        self.marks.push(Mark::Text(text));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Colour = Colour([0xc0, 0, 0]);

    fn with_path(pen: Pen) -> Drawing {
        let mut drawing = Drawing::new(40.0, 20.0);
        drawing.path(vec![[5.0, 10.0], [20.0, 2.5], [35.0, 10.0]], pen);
        drawing
    }

    #[test]
    fn a_path_is_one_open_line() {
        let svg = with_path(Pen::dashes(RED, 2.0)).svg();
        let expected = "<polyline points=\"5,10 20,2.5 35,10\" fill=\"none\" stroke-linejoin=\"round\" \
                        stroke=\"#c00000\" stroke-width=\"2\" stroke-dasharray=\"4 3\"/>";
        assert!(svg.contains(expected), "{svg}");
    }

    #[test]
    fn a_path_leaves_pixels() {
        let blank = Drawing::new(40.0, 20.0).png().unwrap();
        let [solid, dashed] =
            [Pen::solid(RED, 2.0), Pen::dashes(RED, 2.0)].map(|pen| with_path(pen).png().unwrap());
        assert!(solid != blank && dashed != blank && solid != dashed);
    }
}
