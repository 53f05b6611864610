//! `kestrel new`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::output::say;
use kestrel_experiments::run_config::RunConfig;

use super::Done;
use crate::shipped;

/// Arguments of `kestrel new`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Name of the task; its file is NAME.yaml, in this folder
    name: String,

    /// Shipped task or example that it begins as: two-gates, hover, land, room-1, race, …
    #[arg(long, value_name = "TASK", default_value = "two-gates")]
    from: String,

    /// Write over a file of this name
    #[arg(long)]
    force: bool,
}

/// Longest name of a task.
const NAME_LIMIT: usize = 60;

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let Arguments { name, from, force } = arguments;
    let usual = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '-';
    ensure!(
        !name.is_empty() && name.len() <= NAME_LIMIT && name.chars().all(usual),
        "found the name `{name}`, expected at most {NAME_LIMIT} lower-case letters, digits and hyphens"
    );
    let path = PathBuf::from(format!("{name}.yaml"));
    if !force && fs::symlink_metadata(&path).is_ok() {
        bail!("{}: found a file of this name, expected none, or --force to write over it", path.display());
    }
    let (template, text) = shipped::template(from)?;
    write_atomically(&path, rewritten(text, Path::new(template), name).as_bytes())?;
    if let Err(error) = RunConfig::load(&path, &[]) {
        // A template that does not stand alone is ours to mend.
        fs::remove_file(&path)?;
        return Err(error.into());
    }
    say(format_args!("{}: change it, then", path.display()))?;
    let file = path.display();
    for (command, what) in [
        ("check", "whether it is right"),
        ("baseline", "who flies it without learning"),
        ("train", "train, evaluate, export and draw"),
    ] {
        say(format_args!("  {:<34} # {what}", format!("kestrel {command} {file}")))?;
    }
    Ok(Done::Finished)
}

/// The text of a shipped file as that of a task of another name, which lies elsewhere.
fn rewritten(text: &str, template: &Path, name: &str) -> String {
    let lines = text.lines().filter(|line| !line.starts_with("# yaml-language-server:"));
    let lines = lines
        .skip_while(|line| *line == "#")
        .map(|line| if line.starts_with("name: ") { format!("name: {name}") } else { of_library(line, template) });
    lines.fold(String::new(), |text, line| text + &line + "\n")
}

/// A line with the files that it imports by their names in the library.
fn of_library(line: &str, template: &Path) -> String {
    if line.trim_start().starts_with('#') {
        return line.to_owned();
    }
    let mut parts = line.split("import: ");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, after| {
        let (written, rest) = after.split_at(after.find([' ', ',', '}']).unwrap_or(after.len()));
        format!("{text}import: kestrel:{}{rest}", beside(template, written))
    })
}

/// The path in the repository of a file that another one imports.
fn beside(template: &Path, written: &str) -> String {
    let folder = template.parent().unwrap_or(Path::new(""));
    let mut path: Vec<&str> = folder.iter().filter_map(|part| part.to_str()).collect();
    for part in written.split('/') {
        if part == ".." {
            path.pop();
        } else {
            path.push(part);
        }
    }
    path.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imports_name_the_library_and_the_rest_stays() {
        let text = "# yaml-language-server: $schema=../schema.json\n#\n# Two gates.\n\nversion: 1\nname: two-gates\n\
                    import: ../aviaries/parts/navigate.yaml # the drone\nscenario:\n  aviary: { import: part.yaml, start: { import: ../a.yaml } }\n";
        let expected = "# Two gates.\n\nversion: 1\nname: mine\n\
                        import: kestrel:configs/aviaries/parts/navigate.yaml # the drone\nscenario:\n  \
                        aviary: { import: kestrel:configs/examples/part.yaml, start: { import: kestrel:configs/a.yaml } }\n";
        assert_eq!(rewritten(text, Path::new("configs/examples/two-gates.yaml"), "mine"), expected);
    }

    #[test]
    fn every_shipped_task_can_be_begun_with() {
        shipped::LIBRARY.install();
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<&str> = shipped::tasks().map(|(name, _)| name).chain(shipped::examples()).collect();
        for name in names {
            let (template, text) = shipped::template(name).unwrap();
            let path = folder.path().join("mine.yaml");
            fs::write(&path, rewritten(text, Path::new(template), "mine")).unwrap();
            let config = RunConfig::load(&path, &[]).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(config.subject().name, "mine", "{name}");
        }
    }
}
