//! What kind of file or folder a path is, for a word when one is given to the wrong command.

use std::ffi::OsStr;
use std::fs;
use std::io::Read as _;
use std::path::Path;

use kestrel_experiments::run_directory::RunDirectory;

/// What commands take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Task,
    Study,
    Search,
    Tests,
    World,
    Airframe,
    Run,
    StudyDirectory,
    SearchDirectory,
    Policy,
    Recording,
    Checkpoint,
    Network,
}

/// How much of a file is read to know it \[bytes\].
const BEGINNING: u64 = 4096;

impl Kind {
    /// Of what is there; nothing where that is nothing of ours.
    fn of(path: &Path) -> Option<Self> {
        if path.is_dir() {
            let markers = [("study.yaml", Self::StudyDirectory), ("search.yaml", Self::SearchDirectory)];
            let marked = markers.into_iter().find(|(file, _)| path.join(file).is_file()).map(|(_, kind)| kind);
            return marked.or_else(|| RunDirectory::config_in(path).is_file().then_some(Self::Run));
        }
        // A device would be opened, a pipe waited for.
        if !path.is_file() {
            return None;
        }
        let mut beginning = Vec::new();
        fs::File::open(path).ok()?.take(BEGINNING).read_to_end(&mut beginning).ok()?;
        let magics: [(&[u8], _); 3] =
            [(b"\x89KPOL", Self::Policy), (b"KESTRELR", Self::Recording), (b"KESTRELC", Self::Checkpoint)];
        let magic = magics.into_iter().find(|(magic, _)| beginning.starts_with(magic));
        let ending = path.extension().and_then(OsStr::to_str);
        match (magic, ending) {
            (Some((_, kind)), _) => Some(kind),
            (None, Some("onnx" | "safetensors")) => Some(Self::Network),
            (None, Some("yaml" | "yml")) => Self::of_yaml(&String::from_utf8_lossy(&beginning)),
            (None, _) => None,
        }
    }

    /// By the keys at the left edge of the text.
    fn of_yaml(text: &str) -> Option<Self> {
        let has =
            |key: &str| text.lines().any(|line| line.strip_prefix(key).is_some_and(|rest| rest.starts_with(':')));
        let kinds = [
            (&["methods", "orders"][..], Self::Study),
            (&["space", "study"], Self::Search),
            (&["flights"], Self::Tests),
            (&["goal_m", "solids", "furniture", "rooms"], Self::World),
            (&["mass_kg"], Self::Airframe),
            (&["scenario", "tasks"], Self::Task),
        ];
        kinds.into_iter().find(|(keys, _)| keys.iter().any(|key| has(key))).map(|(_, kind)| kind)
    }

    /// What it is, and what can be done with it.
    fn about(self, path: &Path) -> String {
        let path = path.display();
        match self {
            Self::Task => format!("{path} is a task: `kestrel train {path}` learns it"),
            Self::Study => format!("{path} is a study: `kestrel study run {path}`"),
            Self::Search => format!("{path} is a search: `kestrel search run {path}`"),
            Self::Tests => format!("{path} holds flight tests: `kestrel test {path}`"),
            Self::World => {
                format!("{path} is a world, which a task imports: `aviary: {{ import: {path} }}` below `scenario`")
            }
            Self::Airframe => {
                format!(
                    "{path} is a drone, which a task imports: `airframe: {{ import: {path} }}` below `scenario.vehicle`"
                )
            }
            Self::Run => format!("{path} is a run: `kestrel evaluate {path}`, `kestrel fly {path}`"),
            Self::StudyDirectory => format!("{path} is the directory of a study: `kestrel study report {path}`"),
            Self::SearchDirectory => {
                format!("{path} is the directory of a search: `kestrel search report {path}`")
            }
            Self::Policy => format!("{path} is a policy file: `kestrel inspect {path}`, `kestrel fly {path}`"),
            Self::Recording => format!("{path} is a recorded flight: `kestrel replay {path}`"),
            Self::Checkpoint => {
                format!("{path} is a checkpoint: `kestrel train --resume RUN` goes on from the last of a run")
            }
            Self::Network => {
                format!("{path} is a network of another program: `kestrel import {path} --task TASK`")
            }
        }
    }

    /// What a command can do something with.
    pub(crate) fn taken_by(command: &str) -> &'static [Self] {
        match command {
            "train" | "baseline" | "bridge" | "bench" => &[Self::Task],
            "check" => &[Self::Task, Self::Run],
            "evaluate" => &[Self::Task, Self::Run, Self::Policy],
            "export" | "inspect" | "fly" => &[Self::Run, Self::Policy],
            "import" => &[Self::Network, Self::Task],
            "test" => &[Self::Tests],
            "render" | "view" | "replay" => &[Self::Task, Self::Run, Self::Policy, Self::Recording],
            "runs" => &[Self::Run],
            "study" => &[Self::Study, Self::StudyDirectory],
            "search" => &[Self::Search, Self::SearchDirectory],
            "aviary" => &[Self::World, Self::Task, Self::Policy],
            _ => &[],
        }
    }
}

/// For the words of a command line that failed: what the first of them is that the command does not take.
pub(crate) fn misplaced<'a>(words: impl IntoIterator<Item = &'a OsStr>) -> Option<String> {
    let mut words = words.into_iter();
    let taken = Kind::taken_by(words.next()?.to_str()?);
    let unfit = |word: &'a OsStr| {
        let path = Path::new(word);
        Kind::of(path).filter(|kind| !taken.is_empty() && !taken.contains(kind)).map(|kind| kind.about(path))
    };
    words.find_map(unfit)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn said(words: &[&str]) -> Option<String> {
        misplaced(words.iter().map(OsStr::new))
    }

    #[test]
    fn every_kind_in_the_repository_is_known() {
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        for (path, kind) in [
            ("configs/hover.yaml", Kind::Task),
            ("configs/crosses.yaml", Kind::Task),
            ("configs/aviaries/room-1.yaml", Kind::Task),
            ("configs/studies/rooms.yaml", Kind::Study),
            ("configs/searches/anchor-strength.yaml", Kind::Search),
            ("configs/tests/hover.yaml", Kind::Tests),
            ("assets/worlds/room-0.yaml", Kind::World),
            ("assets/airframes/x500.yaml", Kind::Airframe),
            ("assets/pilots/hover.kestrel", Kind::Policy),
        ] {
            assert_eq!(Kind::of(&repository.join(path)), Some(kind), "{path}");
        }
        assert_eq!([Kind::of(&repository.join("README.md")), Kind::of(&repository.join("docs"))], [None; 2]);
    }

    #[test]
    fn what_a_command_takes_is_not_misplaced() {
        let study = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/studies/rooms.yaml");
        assert!(said(&["train", study]).unwrap().ends_with(&format!("is a study: `kestrel study run {study}`")));
        assert_eq!(
            [said(&["study", "run", study]), said(&["completions", study]), said(&[])],
            [const { None }; 3]
        );
        assert_eq!(said(&["train", "nowhere.yaml", "--seed", "0"]), None);
    }

    #[test]
    fn every_command_that_takes_files_of_ours_says_which() {
        let others = ["new", "identify", "verify", "schema", "completions"];
        for command in crate::Arguments::command().get_subcommands() {
            let name = command.get_name();
            assert_eq!(Kind::taken_by(name).is_empty(), others.contains(&name), "{name}");
        }
    }
}
