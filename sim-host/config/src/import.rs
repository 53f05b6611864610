//! `import: PATH` in any mapping: the mapping of that file, with the other keys of this one laid over it.
//!
//! Paths are relative to the file in which they stand; `NAME:PATH` is a file of a [`Library`]. Mappings merge key by key,
//! lists and everything else replace.

#[cfg(test)]
mod tests;

use std::fs;
use std::marker::PhantomData;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, OnceLock};

use crate::error::{ConfigError, Place, Source};
use crate::node::{Entry, Node, Value};
use crate::notation::{ImportedFile, Notations, tree_of};
use crate::text::{Unreadable, read_text};

/// The key.
pub(crate) const IMPORT: &str = "import";

/// Longest chain of files that import each other; the example worlds have two.
const DEPTH_LIMIT: usize = 8;

/// Most imports in one configuration, counted with repetitions, so that files which import each other twice come to an end; a
/// study of a thousand furnished rooms has about fifteen thousand.
const FILES_LIMIT: usize = 16_384;

/// Most text imported by one configuration \[bytes\]; a furnished room has about 20 KiB.
const TEXT_LIMIT: usize = 64 << 20;

/// What a file that is imported should be.
const EXPECTED: &str = "the path of a YAML file, relative to the file that imports it";

/// A folder of files that any configuration may import, wherever it lies itself: `import: kestrel:hover.yaml`.
#[derive(Clone, Copy, Debug)]
pub struct Library {
    /// What stands before the colon.
    pub name: &'static str,
    /// Where its files are, asked for at every import, or why they are nowhere.
    pub folder: fn() -> Result<PathBuf, String>,
}

/// The library of this program.
static LIBRARY: OnceLock<Library> = OnceLock::new();

impl Library {
    /// Makes it the one of this program; the first that is installed stays.
    pub fn install(self) {
        LIBRARY.get_or_init(|| self);
    }
}

/// What the files imported by one configuration have in common.
#[derive(Clone, Debug)]
pub(crate) struct Imports<N> {
    /// The configuration's own file.
    root: PathBuf,
    files: usize,
    bytes: usize,
    notations: PhantomData<N>,
}

/// Where an import stands: keys down to its mapping, and the files on the way, innermost last.
#[derive(Clone)]
pub(crate) struct Trail {
    keys: Vec<String>,
    files: Vec<PathBuf>,
}

impl<N: Notations> Imports<N> {
    /// For the configuration in the file at `root`, which need not exist.
    pub(crate) fn of(root: &Path) -> Self {
        Self { root: root.to_owned(), files: 0, bytes: 0, notations: PhantomData }
    }

    /// The trail of what is written at `keys` of the configuration itself.
    pub(crate) fn trail(&self, keys: &[&str]) -> Trail {
        Trail { keys: keys.iter().map(|&key| key.to_owned()).collect(), files: vec![self.root.clone()] }
    }

    /// The node with every import below it carried out.
    pub(crate) fn expand(&mut self, node: Node, trail: &Trail) -> Result<Node, ConfigError> {
        let Node { value, place, import } = node;
        let value = match value {
            Value::List(items) => Value::List(
                items
                    .into_iter()
                    .enumerate()
                    .map(|(index, item)| self.expand(item, &trail.below(&index.to_string())))
                    .collect::<Result<_, _>>()?,
            ),
            Value::Mapping(entries) => return self.expand_mapping(entries, place, trail),
            scalar @ (Value::Nothing | Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_)) => {
                scalar
            }
        };
        Ok(Node { value, place, import })
    }

    fn expand_mapping(&mut self, entries: Vec<Entry>, place: Place, trail: &Trail) -> Result<Node, ConfigError> {
        let (imports, written): (Vec<_>, Vec<_>) = entries.into_iter().partition(|entry| entry.key == IMPORT);
        let expanded = |entry: Entry| {
            let node = self.expand(entry.node, &trail.below(&entry.key))?;
            Ok(Entry { node, ..entry })
        };
        let written = Value::Mapping(written.into_iter().map(expanded).collect::<Result<_, _>>()?);
        let written = Node { value: written, place, import: None };
        match imports.first() {
            None => Ok(written),
            Some(import) => Ok(written.over(self.load(&import.node, trail)?)),
        }
    }

    /// The mapping of the file that `import` names, everything in it imported too.
    pub(crate) fn load(&mut self, import: &Node, trail: &Trail) -> Result<Node, ConfigError> {
        let place = &import.place;
        let refuse = |found: String, expected: &str| ConfigError::at(place, &trail.key(), found, expected);
        let Value::Text(written) = &import.value else {
            return Err(refuse(import.value.to_string(), EXPECTED));
        };
        let (path, inner) = trail.to(written).map_err(|found| refuse(found, EXPECTED))?;
        let name = path.display().to_string();
        if let Some(first) = trail.files.iter().position(|file| same(file, &path)) {
            let found = format!("a cycle ({})", inner.shown_from(first));
            return Err(refuse(found, "files that do not import themselves"));
        }
        if trail.files.len() > DEPTH_LIMIT {
            let found = format!("a chain of imports that is too long ({})", inner.shown_from(0));
            return Err(refuse(found, &format!("at most {DEPTH_LIMIT} imports in a chain")));
        }
        let key = trail.key();
        let mapping_key = trail.keys.last().map(String::as_str);
        if let Some((node, bytes)) =
            N::file(&ImportedFile { path: &path, importer: place, key: &key, mapping_key })?
        {
            self.count(bytes).map_err(|(found, expected)| refuse(found, &expected))?;
            return Ok(node);
        }
        let text = read_text(&path).map_err(|fault| match fault {
            Unreadable::Bytes { line, column, byte } => {
                let source =
                    Source::File { name: name.clone(), text: String::new(), importer: Some(place.clone()) };
                let place = Place { source: Arc::new(source), line, column };
                ConfigError::at(&place, "", format!("the byte 0x{byte:02x}"), "text in UTF-8")
            }
            Unreadable::Long(_) => refuse(format!("{fault} ({name})"), "a file of a few KiB"),
            other @ (Unreadable::Missing | Unreadable::Folder | Unreadable::Broken(_)) => {
                refuse(format!("{other} ({name})"), EXPECTED)
            }
        })?;
        self.count(text.len()).map_err(|(found, expected)| refuse(found, &expected))?;
        let source = Arc::new(Source::File { name, text, importer: Some(place.clone()) });
        let root = mapping::<N>(&source)?;
        let mut loaded = self.expand(root, &inner)?;
        loaded.import = Some(place.clone());
        Ok(loaded)
    }

    /// Counts one more file, or says what is too much.
    fn count(&mut self, bytes: usize) -> Result<(), (String, String)> {
        self.files += 1;
        self.bytes += bytes;
        if self.files > FILES_LIMIT {
            return Err((format!("import number {}", self.files), format!("at most {FILES_LIMIT} in all")));
        }
        if self.bytes > TEXT_LIMIT {
            let found = format!("{} KiB of imported text so far", self.bytes >> 10);
            return Err((found, format!("at most {} KiB in all", TEXT_LIMIT >> 10)));
        }
        Ok(())
    }
}

/// The mapping in an imported text.
fn mapping<N: Notations>(source: &Arc<Source>) -> Result<Node, ConfigError> {
    let root = tree_of::<N>(source)?;
    match &root.value {
        Value::Mapping(_) => Ok(root),
        Value::Nothing => Err(ConfigError::at(&root.place, "", "an empty file", "keys to import")),
        other @ (Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) | Value::List(_)) => {
            Err(ConfigError::at(&root.place, "", other, "keys to import"))
        }
    }
}

impl Trail {
    fn below(&self, key: &str) -> Self {
        let mut trail = self.clone();
        trail.keys.push(key.to_owned());
        trail
    }

    /// The key that a message about the import names.
    pub(crate) fn key(&self) -> String {
        let keys: Vec<&str> = self.keys.iter().map(String::as_str).chain([IMPORT]).collect();
        keys.join(".")
    }

    /// The path of the file called `written` here, and the trail into it, or why it is nowhere.
    fn to(&self, written: &str) -> Result<(PathBuf, Self), String> {
        let of_library = LIBRARY.get().and_then(|library| {
            let path = written.strip_prefix(library.name)?.strip_prefix(':')?;
            Some((library.folder)().map(|folder| folder.join(path)))
        });
        let here = || self.files.last().and_then(|file| file.parent()).unwrap_or(Path::new(""));
        let path = tidied(&of_library.transpose()?.unwrap_or_else(|| here().join(written)));
        let mut inner = self.clone();
        inner.files.push(path.clone());
        Ok((path, inner))
    }

    /// The files of the chain from the one with index `first`, as a message shows them.
    fn shown_from(&self, first: usize) -> String {
        let names: Vec<String> = self.files[first..].iter().map(|file| file.display().to_string()).collect();
        names.join(" → ")
    }
}

/// Whether both paths lead to the same file.
fn same(one: &Path, other: &Path) -> bool {
    match (fs::canonicalize(one), fs::canonicalize(other)) {
        (Ok(one), Ok(other)) => one == other,
        (Ok(_) | Err(_), Ok(_) | Err(_)) => false,
    }
}

/// `a/../b` as `b` where both are the same file, which symbolic links can prevent.
fn tidied(path: &Path) -> PathBuf {
    let mut tidy = PathBuf::new();
    for component in path.components() {
        let ends_in_name = matches!(tidy.components().next_back(), Some(Component::Normal(_)));
        match component {
            Component::ParentDir if ends_in_name => {
                tidy.pop();
            }
            Component::CurDir => {}
            Component::ParentDir | Component::Normal(_) | Component::RootDir | Component::Prefix(_) => {
                tidy.push(component);
            }
        }
    }
    if !path.exists() || same(&tidy, path) { tidy } else { path.to_owned() }
}
