//! What the compiler and its lints don't ask of our sources: signatures that say what they take, and names that mean one
//! thing.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use syn::spanned::Spanned;
use syn::visit::Visit;

/// Folders whose sources are ours; each `src` below them is a crate.
const FOLDERS: [&str; 4] = ["core-nostd", "sim-host", "trainer-host", "firmware-shim"];

/// Names that several modules give to a type on purpose, and use with the module's name.
const CONVENTIONS: [&str; 3] = ["Arguments", "Config", "Error"];

/// Types of one name that wait for another: as written in a file and as they run, or of two recordings.
const TWINS: [&str; 4] = ["ActionKind", "Method", "Place", "PublishedRow"];

/// Lines of a function, braces included.
const LINES_LIMIT: usize = 60;

/// A source file: its crate's folder, its path from the root, what it holds.
struct Source {
    package: PathBuf,
    path: PathBuf,
    file: syn::File,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Sources of every crate; tests are left out, and what stands for a part of the core where its feature is off.
fn sources() -> Vec<Source> {
    let root = root();
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = FOLDERS.map(PathBuf::from).to_vec();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root.join(&folder)).unwrap() {
            let path = folder.join(entry.unwrap().file_name());
            let name = path.file_name().unwrap().to_str().unwrap();
            if root.join(&path).is_dir() {
                if !["tests", "target", "examples"].contains(&name) {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|extension| extension == "rs")
                && !["tests.rs", "without_px4.rs", "without_reference.rs"].contains(&name)
                && path.components().any(|part| part.as_os_str() == "src")
            {
                let file = syn::parse_file(&fs::read_to_string(root.join(&path)).unwrap()).unwrap();
                let package = path.ancestors().find(|folder| folder.ends_with("src")).unwrap().to_owned();
                found.push(Source { package, path, file });
            }
        }
    }
    found.sort_by(|one, other| one.path.cmp(&other.path));
    found
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute.meta.require_list().is_ok_and(|list| list.tokens.to_string().starts_with("test"))
    })
}

/// How many values a tuple holds, those of tuples within it included.
fn parts(kind: &syn::Type) -> usize {
    if let syn::Type::Reference(reference) = kind {
        return parts(&reference.elem);
    }
    if let syn::Type::Tuple(tuple) = kind { tuple.elems.iter().map(parts).sum() } else { 1 }
}

/// Parameters that are tuples of more than two parts, and functions that are too long.
struct Functions<'a> {
    path: &'a Path,
    tuples: Vec<String>,
    long: Vec<String>,
}

impl Functions<'_> {
    fn of(source: &Source) -> Functions<'_> {
        let mut functions = Functions { path: &source.path, tuples: Vec::new(), long: Vec::new() };
        functions.visit_file(&source.file);
        functions
    }

    fn measure(&mut self, signature: &syn::Signature, body: &syn::Block) {
        let lines = body.span().end().line - body.span().start().line + 1;
        let name = signature.ident.to_string();
        if lines > LINES_LIMIT {
            self.long.push(format!("{}: {name} has {lines} lines", self.path.display()));
        }
    }
}

impl<'ast> Visit<'ast> for Functions<'_> {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_test(&module.attrs) {
            syn::visit::visit_item_mod(self, module);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.measure(&item.sig, &item.block);
        syn::visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.measure(&item.sig, &item.block);
        syn::visit::visit_impl_item_fn(self, item);
    }

    fn visit_signature(&mut self, signature: &'ast syn::Signature) {
        for input in &signature.inputs {
            let syn::FnArg::Typed(parameter) = input else { continue };
            if parts(&parameter.ty) > 2 {
                let line = parameter.span().start().line;
                self.tuples.push(format!("{}:{line}: {}", self.path.display(), signature.ident));
            }
        }
        syn::visit::visit_signature(self, signature);
    }
}

#[test]
fn no_parameter_is_a_tuple_of_more_than_two_parts() {
    let found: Vec<_> = sources().iter().flat_map(|source| Functions::of(source).tuples).collect();
    assert!(found.is_empty(), "{} parameters want a struct with a name:\n{}", found.len(), found.join("\n"));
}

#[test]
fn no_function_is_over_sixty_lines() {
    let found: Vec<_> = sources().iter().flat_map(|source| Functions::of(source).long).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Names of the public types of a file.
#[derive(Default)]
struct Types {
    found: Vec<String>,
}

impl Types {
    fn add(&mut self, visibility: &syn::Visibility, name: &syn::Ident) {
        if matches!(visibility, syn::Visibility::Public(_)) {
            self.found.push(name.to_string());
        }
    }
}

impl<'ast> Visit<'ast> for Types {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_test(&module.attrs) {
            syn::visit::visit_item_mod(self, module);
        }
    }

    fn visit_item_struct(&mut self, item: &'ast syn::ItemStruct) {
        self.add(&item.vis, &item.ident);
    }

    fn visit_item_enum(&mut self, item: &'ast syn::ItemEnum) {
        self.add(&item.vis, &item.ident);
    }

    fn visit_item_type(&mut self, item: &'ast syn::ItemType) {
        self.add(&item.vis, &item.ident);
    }

    fn visit_item_trait(&mut self, item: &'ast syn::ItemTrait) {
        self.add(&item.vis, &item.ident);
    }
}

#[test]
fn a_name_of_a_public_type_means_one_thing_in_a_crate() {
    let mut homes: BTreeMap<(PathBuf, String), Vec<String>> = BTreeMap::new();
    // A reward and a termination are named by their modules.
    let is_term = |path: &Path| {
        ["src/reward", "src/termination"].iter().any(|folder| path.starts_with(Path::new("sim-host").join(folder)))
    };
    for source in sources().into_iter().filter(|source| !is_term(&source.path)) {
        let mut types = Types::default();
        types.visit_file(&source.file);
        for name in types.found {
            homes.entry((source.package.clone(), name)).or_default().push(source.path.display().to_string());
        }
    }
    homes.retain(|(_, name), places| {
        places.len() > 1 && !CONVENTIONS.contains(&name.as_str()) && !TWINS.contains(&name.as_str())
    });
    let lines: Vec<_> = homes.iter().map(|((_, name), places)| format!("{name}: {}", places.join(", "))).collect();
    assert!(lines.is_empty(), "{} names stand for several types:\n{}", lines.len(), lines.join("\n"));
}
