//! Meshes from files: Wavefront's OBJ with the colours of its materials, and STL, as text or binary.
//!
//! `import: chair.obj` in a `mesh` is the tree that it would have in YAML: its triangles in a few words of OBJ (`obj`) and
//! the colours of its materials (`materials`), so that a resolved configuration needs no other file.

mod materials;
mod obj;
mod stl;
#[cfg(test)]
mod tests;
mod words;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use kestrel_config::ConfigError;
use kestrel_config::error::{Place, Source};
use kestrel_config::node::{Entry, Node, Value};
use kestrel_config::notation::ImportedFile;
use kestrel_config::text::{not_text, read_bytes};

pub(super) use obj::parse;

/// The key whose mapping may import a mesh.
pub(super) const MESH: &str = "mesh";

/// Largest file of a mesh \[bytes\].
const SIZE_LIMIT: u64 = 16 << 20;

/// Most triangles of a mesh: what is looked at for every image.
pub(super) const TRIANGLES_LIMIT: usize = 65_536;

/// What a file that is imported as a mesh should be.
const EXPECTED: &str = "a mesh: a file `.obj` or `.stl`, relative to the file that imports it";

/// A surface of triangles, part by part.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Surface {
    pub(super) corners: Vec<[f64; 3]>,
    pub(super) parts: Vec<Part>,
    /// Names of materials, which triangles know by their index.
    pub(super) materials: Vec<String>,
    /// Files with the colours of materials, and where they are named.
    libraries: Vec<(String, TextPosition)>,
}

/// The triangles of one name.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Part {
    /// Empty where a file gives none.
    pub(super) name: String,
    pub(super) triangles: Vec<Triangle>,
}

/// Indices of corners, counterclockwise as seen from outside, and of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle {
    pub(super) corners: [u32; 3],
    pub(super) material: Option<usize>,
}

/// A place in a text; line and column count from one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TextPosition {
    pub(super) line: usize,
    pub(super) column: usize,
}

/// What is wrong with a text, and where.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    pub(super) position: TextPosition,
    pub(super) found: String,
    pub(super) expected: String,
}

impl Fault {
    fn new(position: TextPosition, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { position, found: found.into(), expected: expected.into() }
    }
}

/// Whether a file that is imported is a mesh, by the end of its name and the key that imports it.
///
/// # Errors
/// For a file of another kind, or a mesh that is imported where none can be.
pub(super) fn is_mesh(file: &ImportedFile<'_>) -> Result<bool, ConfigError> {
    let extension = file.path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    let refuse = |what: &str, expected: &str| Err(file.refuse(what, expected));
    match (extension.as_deref(), file.mapping_key == Some(MESH)) {
        (Some("obj" | "stl"), true) => Ok(true),
        (Some("obj" | "stl"), false) => refuse("a mesh", "meshes only in a key `mesh`: `mesh: { import: … }`"),
        (Some("yaml" | "yml"), _) | (_, false) => Ok(false),
        (Some(_) | None, true) => refuse("a file of another kind", EXPECTED),
    }
}

/// What the file says in the words of a configuration, and how long that is \[bytes\].
pub(super) fn tree(file: &ImportedFile<'_>) -> Result<(Node, usize), ConfigError> {
    let path = file.path;
    let file = File(*file);
    let bytes = read_bytes(path, SIZE_LIMIT).map_err(|fault| file.0.refuse(fault, EXPECTED))?;
    let is_stl = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("stl"));
    let (surface, colours) = if is_stl && stl::is_binary(&bytes) {
        (stl::binary(&bytes).map_err(|(found, expected)| file.0.refuse(found, expected))?, BTreeMap::new())
    } else {
        let text = file.text(path, bytes)?;
        let parsed = if is_stl { stl::text(&text) } else { obj::parse(&text) };
        let surface = parsed.map_err(|fault| file.fault(path, &text, fault))?;
        let colours = file.colours(&text, &surface)?;
        (surface, colours)
    };
    Ok(file.node(&surface.written(&colours), &colours))
}

struct File<'a>(ImportedFile<'a>);

impl File<'_> {
    fn text(&self, path: &Path, bytes: Vec<u8>) -> Result<String, ConfigError> {
        String::from_utf8(bytes).map_err(|error| {
            let (line, column, byte) = not_text(&error);
            let position = TextPosition { line, column };
            self.fault(path, "", Fault::new(position, format!("the byte 0x{byte:02x}"), "text in UTF-8"))
        })
    }

    fn fault(&self, path: &Path, text: &str, fault: Fault) -> ConfigError {
        let importer = Some(self.0.importer.clone());
        let source = Source::File { name: path.display().to_string(), text: text.to_owned(), importer };
        let place = Place { source: Arc::new(source), line: fault.position.line, column: fault.position.column };
        ConfigError::at(&place, "", fault.found, fault.expected)
    }

    /// Those of the materials in the libraries that `text`, the file, names.
    fn colours(&self, text: &str, surface: &Surface) -> Result<BTreeMap<String, [f64; 3]>, ConfigError> {
        let mut colours = BTreeMap::new();
        for (name, position) in &surface.libraries {
            let path: PathBuf = self.0.path.parent().unwrap_or(Path::new("")).join(name);
            let bytes = read_bytes(&path, SIZE_LIMIT).map_err(|fault| {
                let found = format!("{fault} ({})", path.display());
                self.fault(self.0.path, text, Fault::new(*position, found, "the file of its materials beside it"))
            })?;
            let library = self.text(&path, bytes)?;
            colours.extend(materials::parse(&library).map_err(|fault| self.fault(&path, &library, fault))?);
        }
        colours.retain(|name, _| surface.materials.contains(name));
        Ok(colours)
    }

    /// The mapping, as if it stood at the beginning of the file.
    fn node(&self, obj: &str, colours: &BTreeMap<String, [f64; 3]>) -> (Node, usize) {
        let place = self.0.beginning();
        let node = |value: Value| Node { value, place: place.clone(), import: None };
        let entry = |key: &str, value: Value| Entry::new(key.to_owned(), place.clone(), node(value));
        let colour = |colour: &[f64; 3]| {
            Value::List(colour.iter().map(|part| node(Value::Number(*part, part.to_string()))).collect())
        };
        let mut entries = vec![entry("obj", Value::Text(obj.to_owned()))];
        if !colours.is_empty() {
            let materials = colours.iter().map(|(name, parts)| entry(name, colour(parts))).collect();
            entries.push(entry("materials", Value::Mapping(materials)));
        }
        let bytes = obj.len() + colours.keys().map(String::len).sum::<usize>();
        (Node { import: Some(self.0.importer.clone()), ..node(Value::Mapping(entries)) }, bytes)
    }
}

impl Surface {
    /// The same in a few words of OBJ: corners that are used, each once, and triangles; materials where they have colours.
    fn written(&self, colours: &BTreeMap<String, [f64; 3]>) -> String {
        let (mut corners, mut faces) = (String::new(), String::new());
        let mut numbers = BTreeMap::new();
        for part in &self.parts {
            let _ = writeln!(faces, "o {}", part.name);
            let mut material = None;
            let _ = writeln!(faces, "usemtl");
            for triangle in &part.triangles {
                let own = triangle.material.filter(|material| colours.contains_key(&self.materials[*material]));
                if own != material {
                    material = own;
                    let name = own.map_or("", |material| &self.materials[material]);
                    let _ = writeln!(faces, "usemtl {name}");
                }
                let [a, b, c] = triangle.corners.map(|corner| {
                    let place = self.corners[corner as usize];
                    let next = numbers.len() + 1;
                    // Adding nought makes the negative one the other.
                    *numbers.entry(place.map(|value| (value + 0.0).to_bits())).or_insert_with(|| {
                        let _ = writeln!(corners, "v {} {} {}", place[0], place[1], place[2]);
                        next
                    })
                });
                let _ = writeln!(faces, "f {a} {b} {c}");
            }
        }
        corners + &faces
    }

    /// Adds a triangle to the last part, unless it has no area by its indices.
    fn push(&mut self, corners: [u32; 3], material: Option<usize>) {
        let [a, b, c] = corners;
        if let Some(part) = self.parts.last_mut().filter(|_| a != b && b != c && c != a) {
            part.triangles.push(Triangle { corners, material });
        }
    }

    /// How many triangles there are.
    fn count(&self) -> usize {
        self.parts.iter().map(|part| part.triangles.len()).sum()
    }
}
