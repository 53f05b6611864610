//! Wavefront's MTL, as far as it says plain colours: `newmtl` and `Kd`. Textures are not drawn.

use std::collections::BTreeMap;

use super::Fault;
use super::words::{three, words};

/// Red, green and blue of each material, from 0 to 1; those without a colour are left out.
pub(super) fn parse(text: &str) -> Result<BTreeMap<String, [f64; 3]>, Fault> {
    let mut colours = BTreeMap::new();
    let mut name = None;
    for (number, line) in (1..).zip(text.lines()) {
        let words: Vec<_> = words(number, line).collect();
        let Some((what, rest)) = words.split_first() else { continue };
        match what.text {
            "newmtl" => name = Some(rest.iter().map(|word| word.text).collect::<Vec<_>>().join(" ")),
            "Kd" => {
                let colour = three(what, rest)?;
                if let Some(outside) = colour.iter().position(|part| !(0.0..=1.0).contains(part)) {
                    return Err(rest[outside].refuse("a number from 0 to 1"));
                }
                let Some(name) = &name else {
                    return Err(Fault::new(what.position, "`Kd` of no material", "`newmtl` before it"));
                };
                colours.insert(name.clone(), colour);
            }
            // Other light, textures and transparency.
            _ => {}
        }
    }
    Ok(colours)
}
