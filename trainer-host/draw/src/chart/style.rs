//! Colours that colour-blind readers can tell apart, and lines.

use crate::drawing::{Colour, Dashed, Pen};

/// Of words.
pub const INK: Colour = Colour([0x1f, 0x29, 0x33]);
/// Of less important words.
pub const MUTED: Colour = Colour([0x5b, 0x66, 0x73]);
/// Of the lines behind.
pub const GRID: Colour = Colour([0xe4, 0xe8, 0xee]);
/// Behind everything.
pub const PAPER: Colour = Colour([0xff, 0xff, 0xff]);

/// Okabe and Ito 2008 without their yellow, which cannot be read on white.
const COLOURS: [Colour; 7] = [
    Colour([0x00, 0x72, 0xb2]),
    Colour([0xd5, 0x5e, 0x00]),
    Colour([0x00, 0x9e, 0x73]),
    Colour([0xcc, 0x79, 0xa7]),
    Colour([0xe6, 0x9f, 0x00]),
    Colour([0x56, 0xb4, 0xe9]),
    Colour([0x1f, 0x29, 0x33]),
];

/// Colour of a line, by its place among them; they recur after seven.
pub fn colour(index: usize) -> Colour {
    COLOURS[index % COLOURS.len()]
}

/// A line by its place: solid for the first seven, dashed for the next, then the same at half the width.
pub fn pen(index: usize, width: f64) -> Pen {
    let dashed = if (index / COLOURS.len()).is_multiple_of(2) { Dashed::Solid } else { Dashed::Dashes };
    Pen { colour: colour(index), width: width / (1 + index / (2 * COLOURS.len())) as f64, dashed }
}

/// A colour that lets so much of the paper through, in \[0, 1\].
pub fn faded(Colour(colour): Colour, share: f64) -> Colour {
    let Colour(paper) = PAPER;
    let mix = |index: usize| {
        let (from, to) = (f64::from(colour[index]), f64::from(paper[index]));
        (from + share * (to - from)).round() as u8
    };
    Colour([mix(0), mix(1), mix(2)])
}
