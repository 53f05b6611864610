//! Words as outlines: the font "`DejaVu` Sans", reduced to Latin, Greek and common signs.

use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

const FILE: &[u8] = include_bytes!("../assets/DejaVuSans.ttf");

/// Height of capital letters, per size.
pub(crate) const CAPITALS: f32 = 0.73;

/// What stands for letters that the font lacks.
const UNKNOWN: char = '?';

fn face() -> Face<'static> {
    Face::parse(FILE, 0).expect("the font is whole")
}

fn glyphs<'a>(face: &'a Face<'_>, words: &'a str) -> impl Iterator<Item = GlyphId> + 'a {
    let known = |letter| face.glyph_index(letter).or_else(|| face.glyph_index(UNKNOWN));
    words.chars().filter_map(known)
}

fn advance(face: &Face<'_>, glyph: GlyphId) -> f32 {
    f32::from(face.glyph_hor_advance(glyph).unwrap_or(0))
}

/// How wide a line of words is at a size \[px\].
pub(crate) fn width(words: &str, size: f32) -> f32 {
    let face = face();
    let units: f32 = glyphs(&face, words).map(|glyph| advance(&face, glyph)).sum();
    units * size / f32::from(face.units_per_em())
}

/// The outlines of a line whose baseline begins at `[x, y]` \[px\]; nothing where there is nothing to see.
pub(crate) fn outlines(words: &str, [x, y]: [f32; 2], size: f32) -> Option<Path> {
    let face = face();
    let scale = size / f32::from(face.units_per_em());
    let mut line = Line { path: PathBuilder::new(), x, y, scale };
    for glyph in glyphs(&face, words) {
        face.outline_glyph(glyph, &mut line);
        line.x += scale * advance(&face, glyph);
    }
    line.path.finish()
}

/// A line in the making: where the next glyph begins, and pixels per unit of the font.
struct Line {
    path: PathBuilder,
    x: f32,
    y: f32,
    scale: f32,
}

impl Line {
    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        [self.x + self.scale * x, self.y - self.scale * y]
    }
}

impl OutlineBuilder for Line {
    fn move_to(&mut self, x: f32, y: f32) {
        let [x, y] = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let [x, y] = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ([x1, y1], [x, y]) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ([x1, y1], [x2, y2], [x, y]) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_that_programs_write_has_an_outline_of_its_own() {
        let letters: Vec<char> = ('!'..='~').chain("äöüß²³°±µ×·–—−≤≥→".chars()).collect();
        let shape = |letter: char| outlines(&letter.to_string(), [0.0, 0.0], 100.0).unwrap();
        for (index, letter) in letters.iter().enumerate() {
            let twin = letters[..index].iter().find(|other| shape(**other) == shape(*letter));
            assert_eq!(twin, None, "{letter}");
        }
        assert_eq!(shape('漢'), shape(UNKNOWN));
    }

    #[test]
    fn digits_are_equally_wide_and_lines_as_wide_as_their_letters() {
        for digit in '0'..='9' {
            assert_eq!(width(&digit.to_string(), 12.0), width("0", 12.0));
        }
        assert!((width("flight", 20.0) - width("fli", 20.0) - width("ght", 20.0)).abs() < 1e-4);
        assert_eq!(width("", 20.0), 0.0);
        assert!(outlines("  ", [0.0, 0.0], 20.0).is_none());
    }

    #[test]
    fn letters_stand_on_their_baseline() {
        let bounds = outlines("H", [10.0, 50.0], 20.0).unwrap().bounds();
        assert!((bounds.bottom() - 50.0).abs() < 0.1 && (bounds.top() - (50.0 - 20.0 * CAPITALS)).abs() < 0.3);
        assert!(bounds.left() > 10.0);
    }
}
