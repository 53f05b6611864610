//! What the program says, kept in files of the repository for tests; `BLESS=1` rewrites them.

use std::fs;
use std::path::{Path, PathBuf};

use kestrel_sim::config::{ConfigError, Document};

/// A path from the root of the repository.
pub(crate) fn in_repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// Compares with a file of the repository, or rewrites it when the environment has `BLESS`.
pub(crate) fn assert_golden(path: &str, actual: &str) {
    let path = in_repository(path);
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, actual).unwrap();
    }
    let expected = fs::read_to_string(&path).unwrap();
    assert!(
        expected == actual,
        "{} is out of date: run the test with BLESS=1 and look at the change",
        path.display()
    );
}

/// Ways to be wrong in one kind of configuration, and the message for each.
pub(crate) struct Messages {
    /// The shortest configuration that is right.
    pub(crate) minimal: &'static str,
    /// Checks such a file with overrides.
    pub(crate) check: fn(Document, &[String]) -> Result<(), ConfigError>,
}

impl Messages {
    /// Compares all blocks of the file at `path`, of which there are at least `least`, with the messages as they are
    /// now; every message says where, what was found and what was expected.
    pub(crate) fn assert_golden(&self, path: &str, least: usize) {
        let golden = fs::read_to_string(in_repository(path)).unwrap();
        let (head, cases) = golden.trim_end().split_once("\n\n").unwrap();
        let answers: Vec<String> = cases.split("\n\n").map(|block| self.answered(block)).collect();
        assert!(answers.len() >= least, "only {} cases", answers.len());
        assert_golden(path, &format!("{head}\n\n{}\n", answers.join("\n\n")));
        for answer in &answers {
            let (_, message) = answer.split_once("! ").unwrap();
            let place = message.split(": ").next().unwrap();
            let numbered = place.split_once(".yaml:").or(place.split_once(".urdf:"));
            let located =
                numbered.is_some_and(|(_, place)| place.starts_with(|letter: char| letter.is_ascii_digit()));
            assert!(located || place.starts_with("--set "), "{answer}");
            assert!(message.contains("found ") && message.contains(", expected "), "{answer}");
        }
    }

    /// One block with the message as it is now.
    fn answered(&self, block: &str) -> String {
        let request: Vec<&str> = block.lines().filter(|line| !line.starts_with('!')).collect();
        let with =
            |mark: &str| -> Vec<&str> { request.iter().filter_map(|line| line.strip_prefix(mark)).collect() };
        let overrides: Vec<String> = with("--set ").into_iter().map(str::to_owned).collect();
        let text = match with("- ").as_slice() {
            [] => self.minimal.to_owned(),
            [taken, ..] => {
                assert_eq!(self.minimal.matches(taken).count(), 1, "`{taken}` is not in the configuration once");
                self.minimal.replace(taken, &with("+ ").join("\n"))
            }
        };
        let message = self.refusal(&request, &text, &overrides).unwrap_or_else(|| "accepted".to_owned());
        let message: Vec<String> = message.lines().map(|line| format!("! {line}")).collect();
        format!("{}\n{}", request.join("\n"), message.join("\n"))
    }

    /// The message about `text` in a folder with the files of the request; it calls the folder
    /// nothing.
    fn refusal(&self, request: &[&str], text: &str, overrides: &[String]) -> Option<String> {
        if request.iter().all(|line| !line.starts_with("@ ")) {
            let checked =
                Document::parse("trial.yaml", text).and_then(|document| (self.check)(document, overrides));
            return checked.err().map(|error| error.to_string());
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trial.yaml");
        fs::write(&path, text).unwrap();
        let mut lines = request.iter().peekable();
        while let Some(line) = lines.next() {
            let Some(file) = line.strip_prefix("@ ") else { continue };
            let (name, times) = file.split_once(' ').unwrap_or((file, "1 times"));
            let times: usize = times.strip_suffix(" times").unwrap().parse().unwrap();
            let mut content = String::new();
            while let Some(line) = lines.next_if(|line| line.starts_with('|')) {
                content.push_str(line.strip_prefix("| ").unwrap_or_default());
                content.push('\n');
            }
            fs::write(folder.path().join(name), content.repeat(times)).unwrap();
        }
        let error = Document::read(&path).and_then(|document| (self.check)(document, overrides)).err()?;
        Some(error.to_string().replace(&format!("{}/", folder.path().display()), ""))
    }
}
