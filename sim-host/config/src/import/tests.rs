use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

use serde::Deserialize;
use tempfile::TempDir;

use crate::{ConfigError, Document, Library};

/// Something to decode: a mapping, a list, a choice.
#[derive(Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Shelf {
    name: String,
    size: Size,
    books: Vec<f64>,
    colour: Option<Colour>,
    below: Option<Box<Shelf>>,
}

#[derive(Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Size {
    wide: f64,
    high: f64,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Colour {
    Red,
    Grey { share: f64 },
    Mixed { parts: u32 },
}

/// A folder with these files; their messages call it nothing.
struct Folder(TempDir);

impl Folder {
    fn with(files: &[(&str, &str)]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (name, text) in files {
            let path = folder.0.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        folder
    }

    fn document(&self, overrides: &[&str]) -> Result<Document, ConfigError> {
        let mut document = Document::read(&self.0.path().join("main.yaml"))?;
        overrides.iter().try_for_each(|assignment| document.set(assignment))?;
        Ok(document)
    }

    fn shelf(&self, overrides: &[&str]) -> Result<Shelf, String> {
        let shown = |error: ConfigError| error.to_string().replace(&format!("{}/", self.0.path().display()), "");
        self.document(overrides).map_err(shown)?.decode().map_err(shown)
    }
}

#[test]
fn keys_here_are_laid_over_those_of_the_file() {
    let folder = Folder::with(&[
        ("main.yaml", "import: parts/shelf.yaml\nsize: {high: 3}\nbooks: [7]\n"),
        ("parts/shelf.yaml", "name: oak\nsize: {wide: 1, high: 2}\nbooks: [1, 2, 3]\n"),
    ]);
    let size = Size { wide: 1.0, high: 3.0 };
    let expected = Shelf { name: "oak".to_owned(), size, books: vec![7.0], ..Shelf::default() };
    assert_eq!(folder.shelf(&[]).unwrap(), expected);
}

#[test]
fn paths_are_relative_to_the_file_in_which_they_stand() {
    let folder = Folder::with(&[
        ("main.yaml", "below: {import: a/one.yaml, name: first}\n"),
        ("a/one.yaml", "name: one\nbelow: {import: ../b/two.yaml}\n"),
        ("b/two.yaml", "import: three.yaml\nbooks: [2]\n"),
        ("b/three.yaml", "name: three\n"),
    ]);
    let first = folder.shelf(&[]).unwrap().below.unwrap();
    let second = first.below.as_ref().unwrap();
    assert_eq!((first.name.as_str(), second.name.as_str()), ("first", "three"));
    assert_eq!(second.books, [2.0]);
}

#[test]
fn a_choice_laid_over_another_replaces_it() {
    let folder = Folder::with(&[
        ("main.yaml", "import: shelf.yaml\ncolour: {mixed: {parts: 3}}\n"),
        ("shelf.yaml", "colour: {grey: {share: 0.5}}\n"),
        ("grey.yaml", "grey: {share: 0.25}\n"),
    ]);
    assert_eq!(folder.shelf(&[]).unwrap().colour, Some(Colour::Mixed { parts: 3 }));
    assert_eq!(folder.shelf(&["colour=red"]).unwrap().colour, Some(Colour::Red));
    let grey = folder.shelf(&["colour={import: grey.yaml}"]).unwrap().colour;
    assert_eq!(grey, Some(Colour::Grey { share: 0.25 }));
}

#[test]
fn a_choice_replaces_the_one_it_lies_over_however_deep_it_was_imported() {
    let part = ("part.yaml", "colour: {mixed: {parts: 3}}\n");
    for (deep, files) in [
        ("part.yaml", vec![]),
        ("one.yaml", vec![("one.yaml", "import: part.yaml\n")]),
        ("two.yaml", vec![("two.yaml", "import: one.yaml\n"), ("one.yaml", "import: part.yaml\n")]),
    ] {
        let main = format!("import: shelf.yaml\nbelow: {{import: {deep}}}\n");
        let shelf = ("shelf.yaml", "below: {colour: {grey: {share: 0.5}}}\n");
        let folder = Folder::with(&[&[("main.yaml", main.as_str()), shelf, part][..], &files].concat());
        assert_eq!(folder.shelf(&[]).unwrap().below.unwrap().colour, Some(Colour::Mixed { parts: 3 }), "{deep}");
    }
}

#[test]
fn what_an_override_chooses_replaces_what_was_imported_but_not_what_was_written() {
    let shelf = ("shelf.yaml", "colour: {grey: {share: 0.5}}\n");
    let imported = Folder::with(&[("main.yaml", "import: shelf.yaml\n"), shelf]);
    let mixed = imported.shelf(&["colour.mixed.parts=3"]).unwrap().colour;
    assert_eq!(mixed, Some(Colour::Mixed { parts: 3 }));
    let written = Folder::with(&[("main.yaml", "colour: {grey: {share: 0.5}}\n")]);
    let refused = written.shelf(&["colour.mixed.parts=3"]).unwrap_err();
    assert!(refused.contains("found the keys `grey` and `mixed`"), "{refused}");
}

#[test]
fn two_choices_in_one_file_stay_a_mistake() {
    let folder = Folder::with(&[
        ("main.yaml", "import: shelf.yaml\n"),
        ("shelf.yaml", "colour:\n  grey: {share: 0.5}\n  mixed: {parts: 3}\n"),
    ]);
    assert_eq!(
        folder.shelf(&[]).unwrap_err(),
        "shelf.yaml:3:3: colour: found the keys `grey` and `mixed`, expected exactly one of `red`, `grey` or `mixed`
  3 |   mixed: {parts: 3}
    |   ^
  imported by main.yaml:1:9"
    );
}

#[test]
fn an_override_changes_what_is_imported_and_what_was_imported() {
    let folder = Folder::with(&[
        ("main.yaml", "below: {import: a.yaml, size: {high: 3}}\n"),
        ("a.yaml", "name: a\nsize: {wide: 1}\nbooks: [1, 2]\nbelow: {name: deep}\n"),
        ("b.yaml", "name: b\n"),
    ]);
    let below = |overrides: &[&str]| *folder.shelf(overrides).unwrap().below.unwrap();
    assert_eq!(below(&["below.books.1=5"]).books, [1.0, 5.0]);
    let swapped = below(&["below.import=b.yaml"]);
    let size = Size { wide: 0.0, high: 3.0 };
    assert_eq!(swapped, Shelf { name: "b".to_owned(), size, ..Shelf::default() });
    let kept = below(&["below.below.size.wide=9", "below.import=b.yaml", "below.name=c"]);
    assert_eq!((kept.name.as_str(), kept.below.unwrap().size.wide), ("c", 9.0));
    assert_eq!(below(&["below.import=b.yaml", "below.import=a.yaml"]), below(&[]));
    assert_eq!(below(&["below={import: b.yaml}"]).size, Size::default());
    assert_eq!(folder.shelf(&["import=b.yaml"]).unwrap().name, "b");
}

#[test]
fn a_wrong_value_is_blamed_on_the_file_that_has_it() {
    let folder = Folder::with(&[
        ("main.yaml", "name: main\nbelow:\n  import: a/one.yaml\n"),
        ("a/one.yaml", "below: {import: two.yaml}\n"),
        ("a/two.yaml", "# comment\nbooks: [1, x]\n"),
    ]);
    assert_eq!(
        folder.shelf(&[]).unwrap_err(),
        "a/two.yaml:2:12: below.below.books.1: found the text \"x\", expected a number
  2 | books: [1, x]
    |            ^
  imported by a/one.yaml:1:17
  imported by main.yaml:3:11"
    );
    assert_eq!(
        folder.shelf(&["below.below.books.0=y"]).unwrap_err(),
        "--set below.below.books.0=y: found the text \"y\", expected a number"
    );
    let field = folder.document(&["below.below.books.1=2"]).unwrap();
    let error = field.root().at("below").at("below").at("books").at(0).refuse("", "two").to_string();
    assert!(error.contains("a/two.yaml:2:9: below.below.books.0: found 1, expected two\n"), "{error}");
}

#[test]
fn files_that_cannot_be_imported_are_refused() {
    let folder = Folder::with(&[("here/text.yaml", "")]);
    let message = |import: &str, content: &[u8]| {
        fs::write(folder.0.path().join("here/text.yaml"), content).unwrap();
        fs::write(folder.0.path().join("main.yaml"), format!("below: {{import: {import}}}\n")).unwrap();
        folder.shelf(&[]).unwrap_err()
    };
    let refused = |import: &str, found: &str| {
        format!(
            "main.yaml:1:17: below.import: found {found}, expected the path of a YAML file, relative to the file that imports it
  1 | below: {{import: {import}}}
    |                 ^"
        )
    };
    assert_eq!(message("none.yaml", b""), refused("none.yaml", "no such file (none.yaml)"));
    assert_eq!(message("here", b""), refused("here", "a directory (here)"));
    assert_eq!(message("[here]", b""), refused("[here]", "a list of 1"));
    let long = "# long\n".repeat(1_300_000);
    assert_eq!(
        message("here/text.yaml", long.as_bytes()),
        "main.yaml:1:17: below.import: found more than 8 MiB (here/text.yaml), expected a file of a few KiB
  1 | below: {import: here/text.yaml}
    |                 ^"
    );
    assert_eq!(
        message("here/text.yaml", b"# nothing\n"),
        "here/text.yaml:2:1: found an empty file, expected keys to import\n  imported by main.yaml:1:17"
    );
    assert_eq!(
        message("here/text.yaml", b"name: \xff\n"),
        "here/text.yaml:1:7: found the byte 0xff, expected text in UTF-8\n  imported by main.yaml:1:17"
    );
    assert_eq!(
        message("here/text.yaml", b"- 1\n"),
        "here/text.yaml:1:1: found a list of 1, expected keys to import\n  1 | - 1\n    | ^\n  imported by main.yaml:1:17"
    );
    let error = message("here/text.yaml", b"name: a\nname: b\n");
    assert!(error.starts_with("here/text.yaml:2:1: found the key `name` a second time"), "{error}");
    assert!(error.ends_with("\n  imported by main.yaml:1:17"), "{error}");
}

#[test]
fn overrides_that_cannot_import_are_refused() {
    let folder = Folder::with(&[("main.yaml", "name: main\nbooks: [1]\n")]);
    let message = |assignment: &str| folder.shelf(&[assignment]).unwrap_err();
    assert_eq!(
        message("below.import=none.yaml"),
        "--set below.import=none.yaml: found no such file (none.yaml), expected the path of a YAML file, relative to the file that imports it"
    );
    assert_eq!(
        message("below={import: none.yaml}"),
        "--set below={import: none.yaml}: below.import: found no such file (none.yaml), expected the path of a YAML file, relative to the file that imports it"
    );
    assert!(message("books.import=main.yaml").contains("found a list of 1 at `books`"));
}

#[test]
fn circles_are_refused_by_whatever_name_they_close() {
    let folder = Folder::with(&[
        ("main.yaml", "below: {import: a/one.yaml}\n"),
        ("a/one.yaml", "below: {import: two.yaml}\n"),
        ("a/two.yaml", "below: {import: ../a/./one.yaml}\n"),
        ("self.yaml", "import: self.yaml\n"),
    ]);
    assert_eq!(
        folder.shelf(&[]).unwrap_err(),
        "a/two.yaml:1:17: below.below.below.import: found a cycle (a/one.yaml → a/two.yaml → a/one.yaml), expected files that do not import themselves
  1 | below: {import: ../a/./one.yaml}
    |                 ^
  imported by a/one.yaml:1:17
  imported by main.yaml:1:17"
    );
    fs::write(folder.0.path().join("main.yaml"), "below: {import: main.yaml}\n").unwrap();
    assert!(folder.shelf(&[]).unwrap_err().contains("found a cycle (main.yaml → main.yaml)"));
}

#[test]
fn long_chains_and_floods_of_imports_are_refused() {
    let names: Vec<String> = (0..12).map(|level| format!("{level}.yaml")).collect();
    let chain = |last: usize| {
        let folder = Folder::with(&[("main.yaml", "import: 1.yaml\n")]);
        for level in 1..=last {
            let text =
                if level == last { "name: end\n".to_owned() } else { format!("import: {}\n", names[level + 1]) };
            fs::write(folder.0.path().join(&names[level]), text).unwrap();
        }
        folder
    };
    assert_eq!(chain(8).shelf(&[]).unwrap().name, "end");
    let error = chain(9).shelf(&[]).unwrap_err();
    assert!(
        error.starts_with("8.yaml:1:9: import: found a chain of imports that is too long (main.yaml → 1.yaml →")
    );
    assert!(error.contains("→ 9.yaml), expected at most 8 imports in a chain\n"), "{error}");

    let folder = Folder::with(&[("3.yaml", "name: end\n")]);
    for (file, next) in [("main.yaml", 1), ("1.yaml", 2), ("2.yaml", 3)] {
        let mut text = "books:\n".to_owned();
        for _ in 0..26 {
            writeln!(text, "  - {{import: {next}.yaml}}").unwrap();
        }
        fs::write(folder.0.path().join(file), text).unwrap();
    }
    let error = folder.shelf(&[]).unwrap_err();
    assert!(error.contains("found import number 16385, expected at most 16384 in all"), "{error}");
}

#[cfg(unix)]
#[test]
fn symbolic_links_keep_their_meaning() {
    let folder = Folder::with(&[
        ("main.yaml", "import: link/../shelf.yaml\n"),
        ("shelf.yaml", "name: wrong\n"),
        ("far/shelf.yaml", "name: right\n"),
        ("far/away/none.yaml", "name: none\n"),
    ]);
    std::os::unix::fs::symlink(folder.0.path().join("far/away"), folder.0.path().join("link")).unwrap();
    assert_eq!(folder.shelf(&[]).unwrap().name, "right");
}

/// Where the library of the test below is.
static SHELVES: OnceLock<PathBuf> = OnceLock::new();

#[test]
fn a_file_of_the_library_is_imported_from_anywhere() {
    let shelves = tempfile::tempdir().unwrap();
    SHELVES.get_or_init(|| shelves.path().to_owned());
    let folder = || SHELVES.get().cloned().ok_or_else(|| "no shelves".to_owned());
    let shelves = shelves.path();
    fs::create_dir_all(shelves.join("parts")).unwrap();
    fs::write(shelves.join("oak.yaml"), "import: parts/size.yaml\nname: oak\n").unwrap();
    fs::write(shelves.join("parts/size.yaml"), "size: { wide: 2.0, high: 3.0 }\n").unwrap();
    Library { name: "shop", folder }.install();
    let main = Folder::with(&[("main.yaml", "import: shop:oak.yaml\nsize: { wide: 4.0 }\n")]);
    let shelf = main.shelf(&[]).unwrap();
    assert_eq!((shelf.name.as_str(), shelf.size), ("oak", Size { wide: 4.0, high: 3.0 }));
    let missing = Folder::with(&[("main.yaml", "import: shop:elm.yaml\n")]).shelf(&[]).unwrap_err();
    assert!(missing.contains("elm.yaml"), "{missing}");
    // A file beside it may have a colon in its name.
    let beside = Folder::with(&[("main.yaml", "import: 'store:a.yaml'\n"), ("store:a.yaml", "name: ash\n")]);
    assert_eq!(beside.shelf(&[]).unwrap().name, "ash");
}
