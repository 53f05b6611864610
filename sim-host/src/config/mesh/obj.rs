//! Wavefront's OBJ: corners (`v`) and polygons (`f`) in parts (`o`, `g`) with materials (`usemtl`, `mtllib`).
//!
//! What says nothing about triangles or colours is read over: `vt`, `vn`, `s`, lines and points.

use super::words::{Word, end, three, words};
use super::{Fault, Part, Surface, TRIANGLES_LIMIT};

/// What a statement begins with.
const STATEMENTS: &str = "`v`, `vt`, `vn`, `f`, `o`, `g`, `s`, `usemtl` or `mtllib`";

/// The sine of an angle by which a polygon may be dented \[rad\].
const DENT: f64 = 1e-3;

/// What a text says.
#[derive(Default)]
struct Reader {
    surface: Surface,
    material: Option<usize>,
}

/// The surface in a text.
pub(in crate::config) fn parse(text: &str) -> Result<Surface, Fault> {
    let mut reader = Reader::default();
    let mut statement = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        statement.extend(words(number, line));
        // A statement may go on in the next line.
        if let Some(last) = statement.last_mut() {
            match last.text.strip_suffix('\\') {
                Some("") => statement.truncate(statement.len() - 1),
                Some(before) => last.text = before,
                None => {
                    reader.read(&statement)?;
                    statement.clear();
                }
            }
        }
    }
    reader.read(&statement)?;
    let mut surface = reader.surface;
    surface.parts.retain(|part| !part.triangles.is_empty());
    if surface.parts.is_empty() {
        return Err(Fault::new(end(text), "no faces", "at least one `f` with three corners"));
    }
    Ok(surface)
}

impl Reader {
    fn read(&mut self, statement: &[Word<'_>]) -> Result<(), Fault> {
        let Some((what, rest)) = statement.split_first() else { return Ok(()) };
        match what.text {
            "v" => self.surface.corners.push(three(what, rest)?),
            "f" => self.face(what, rest)?,
            "o" | "g" => self.part(&name(rest)),
            "usemtl" => self.material = self.named_material(&name(rest)),
            "mtllib" => self.surface.libraries.push((name(rest), rest.first().unwrap_or(what).position)),
            "vt" | "vn" | "s" | "l" | "p" => {}
            _ => return Err(what.refuse(STATEMENTS)),
        }
        Ok(())
    }

    /// The part of a name becomes the last, and the one that triangles are added to.
    fn part(&mut self, name: &str) {
        let parts = &mut self.surface.parts;
        let part = match parts.iter().position(|part| part.name == name) {
            Some(place) => parts.remove(place),
            None => Part { name: name.to_owned(), triangles: Vec::new() },
        };
        parts.push(part);
    }

    fn named_material(&mut self, name: &str) -> Option<usize> {
        let materials = &mut self.surface.materials;
        let known = materials.iter().position(|other| other == name);
        (!name.is_empty()).then(|| {
            known.unwrap_or_else(|| {
                materials.push(name.to_owned());
                materials.len() - 1
            })
        })
    }

    /// A convex polygon as triangles around its first corner.
    fn face(&mut self, what: &Word<'_>, words: &[Word<'_>]) -> Result<(), Fault> {
        if words.len() < 3 {
            return Err(Fault::new(what.position, format!("a face of {} corners", words.len()), "three or more"));
        }
        let corners = words.iter().map(|word| self.corner(word)).collect::<Result<Vec<_>, _>>()?;
        if self.is_dented(&corners) {
            let expected = "triangles and convex polygons (triangulate when exporting)";
            return Err(Fault::new(what.position, "a face that is not convex", expected));
        }
        if self.surface.parts.is_empty() {
            self.part("");
        }
        for pair in corners[1..].windows(2) {
            self.surface.push([corners[0], pair[0], pair[1]], self.material);
        }
        if self.surface.count() > TRIANGLES_LIMIT {
            let expected = format!("at most {TRIANGLES_LIMIT} in a mesh");
            return Err(Fault::new(what.position, format!("triangle number {}", self.surface.count()), expected));
        }
        Ok(())
    }

    /// The index of the corner in `7`, `7/1`, `7//3` or `7/1/3`; negative ones count from the last corner so far.
    fn corner(&self, word: &Word<'_>) -> Result<u32, Fault> {
        let count = self.surface.corners.len() as i64;
        let index = word.text.split('/').next().and_then(|index| index.parse::<i64>().ok());
        let place = match index {
            Some(index) if index > 0 => index - 1,
            Some(index) if index < 0 => count + index,
            Some(_) | None => return Err(word.refuse("a corner of a face, such as `7`, `7/1` or `7/1/3`")),
        };
        if (0..count).contains(&place) {
            return Ok(place as u32);
        }
        Err(word.refuse(format!("one of the {count} corners (`v`) above")))
    }

    /// Whether a polygon turns both ways, or more than once around.
    fn is_dented(&self, polygon: &[u32]) -> bool {
        if polygon.len() == 3 {
            return false;
        }
        let corner =
            |index: usize| nalgebra::Vector3::from(self.surface.corners[polygon[index % polygon.len()] as usize]);
        let normal: nalgebra::Vector3<f64> =
            (2..polygon.len()).map(|k| (corner(k - 1) - corner(0)).cross(&(corner(k) - corner(0)))).sum();
        let Some(normal) = normal.try_normalize(0.0) else { return true };
        let turns = |index: usize| {
            let (before, behind) = (corner(index + 1) - corner(index), corner(index + 2) - corner(index + 1));
            before.cross(&behind).dot(&normal) >= -DENT * before.norm() * behind.norm()
        };
        let spans = |index: usize| {
            let (one, other) = (corner(index) - corner(0), corner(index + 1) - corner(0));
            one.cross(&other).dot(&normal) >= -DENT * one.norm() * other.norm()
        };
        !(0..polygon.len()).all(turns) || !(1..polygon.len() - 1).all(spans)
    }
}

fn name(words: &[Word<'_>]) -> String {
    words.iter().map(|word| word.text).collect::<Vec<_>>().join(" ")
}
