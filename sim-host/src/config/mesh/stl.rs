//! STL: triangles without more, as text or binary.

use super::words::{Word, end, three, words};
use super::{Fault, Part, Surface, TRIANGLES_LIMIT};

/// Bytes before the number of triangles, and of each triangle: a normal, three corners, and two of no meaning.
const HEADER: usize = 80;
const TRIANGLE: usize = 50;

/// Whether a file is no text: it does not begin as a text would, or has noughts in its header. Some begin so, too.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    !bytes.starts_with(b"solid") || bytes.iter().take(HEADER + 4).any(|byte| *byte == 0)
}

/// The number of triangles that a binary file says.
fn stated(bytes: &[u8]) -> Option<u32> {
    let count = bytes.get(HEADER..HEADER + 4)?;
    Some(u32::from_le_bytes(count.try_into().ok()?))
}

/// Bytes of a file of so many triangles.
fn length(triangles: u32) -> u64 {
    (HEADER + 4) as u64 + u64::from(triangles) * TRIANGLE as u64
}

/// The surface in a binary file, or what was found and expected.
pub(super) fn binary(bytes: &[u8]) -> Result<Surface, (String, String)> {
    let count = stated(bytes).ok_or_else(|| {
        (format!("{} bytes", bytes.len()), format!("an STL, which has at least {} bytes", HEADER + 4))
    })?;
    if bytes.len() as u64 != length(count) {
        let expected = format!("{}, the length of an STL of the {count} triangles that it says", length(count));
        return Err((format!("{} bytes", bytes.len()), expected));
    }
    if !(1..=TRIANGLES_LIMIT).contains(&(count as usize)) {
        return Err((format!("{count} triangles"), format!("1 to {TRIANGLES_LIMIT}")));
    }
    let mut surface = empty();
    for (index, triangle) in bytes[HEADER + 4..].chunks_exact(TRIANGLE).enumerate() {
        let numbers = triangle[12..48].as_chunks().0;
        for (place, corner) in numbers.as_chunks::<3>().0.iter().enumerate() {
            let corner = corner.map(|bytes| f64::from(f32::from_le_bytes(bytes)));
            if let Some(wrong) = corner.iter().find(|number| !number.is_finite()) {
                let byte = HEADER + 4 + index * TRIANGLE + 12 + 12 * place;
                let found = format!("{wrong} in a corner of triangle {} at byte {byte}", index + 1);
                return Err((found, "finite numbers".to_owned()));
            }
            surface.corners.push(corner);
        }
        close(&mut surface);
    }
    Ok(surface)
}

/// The surface in a text.
pub(super) fn text(text: &str) -> Result<Surface, Fault> {
    let mut surface = empty();
    let (mut facet, mut ended) = (None, false);
    for (number, line) in (1..).zip(text.lines()) {
        let words: Vec<_> = words(number, line).collect();
        let Some((what, rest)) = words.split_first() else { continue };
        match what.text {
            "facet" => facet = Some((what.position, surface.corners.len())),
            "vertex" => surface.corners.push(three(what, rest)?),
            "endfacet" => {
                let corners = facet.take().map_or(0, |(_, first)| surface.corners.len() - first);
                if corners != 3 {
                    return Err(Fault::new(what.position, format!("a facet of {corners} corners"), "three"));
                }
                close(&mut surface);
                check_count(&surface, what)?;
            }
            "endsolid" => ended = true,
            "solid" | "outer" | "endloop" => {}
            _ => {
                let expected = "`solid`, `facet`, `outer loop`, `vertex`, `endloop`, `endfacet` or `endsolid`";
                return Err(what.refuse(expected));
            }
        }
    }
    if let Some((position, _)) = facet {
        return Err(Fault::new(position, "a facet without its end", "`endfacet` after three `vertex`"));
    }
    if !ended {
        return Err(Fault::new(end(text), "the end of the file", "`endsolid` before it"));
    }
    if surface.count() == 0 {
        return Err(Fault::new(end(text), "no faces", "at least one `facet`"));
    }
    Ok(surface)
}

fn empty() -> Surface {
    Surface { parts: vec![Part::default()], ..Surface::default() }
}

/// Makes a triangle of the last three corners.
fn close(surface: &mut Surface) {
    let end = surface.corners.len() as u32;
    surface.push([end - 3, end - 2, end - 1], None);
}

fn check_count(surface: &Surface, what: &Word<'_>) -> Result<(), Fault> {
    let count = surface.count();
    if count <= TRIANGLES_LIMIT {
        return Ok(());
    }
    Err(Fault::new(
        what.position,
        format!("triangle number {count}"),
        format!("at most {TRIANGLES_LIMIT} in a mesh"),
    ))
}
