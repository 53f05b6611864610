//! The tasks and pilots that come with the program, by name: `hover`, `room-1`.
//!
//! The program carries them with all that they import. Whoever names one finds it as a file in the user's cache: what reads files
//! need not know, and messages name a file that can be opened.

use std::path::{Path, PathBuf};
use std::{env, fs};

use anyhow::{Context, Result, bail};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_sim::config::Library;

/// Paths in the repository, and contents.
const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// How alike two names are, from 0 to 1, for one to be offered for the other.
const LIKENESS: f64 = 0.7;

/// Tasks with a pilot that are offered for a name that is like none; of others as many.
const SOME: [&str; 3] = ["hover", "room-1", "land"];

/// Name of the repository's files in imports of other people's files: `import: kestrel:configs/hover.yaml`.
pub(crate) const LIBRARY: Library =
    Library { name: "kestrel", folder: || unpacked().map_err(|error| format!("no shipped files ({error:#})")) };

/// A task, or an example of docs/your-task.md, by name: its path in the repository, and its text.
pub(crate) fn template(name: &str) -> Result<(&'static str, &'static str)> {
    let named = tasks().find(|(known, _)| *known == name).map(|(_, path)| path);
    let example = format!("configs/examples/{name}.yaml");
    let file = FILES.iter().find(|(path, _)| named.map_or(*path == example, |named| *path == named));
    let Some((path, text)) = file else {
        let names = offered(name, tasks().map(|(name, _)| name).chain(examples()));
        bail!("{name}: found no task of this name, expected one: {names}");
    };
    Ok((path, std::str::from_utf8(text).context("configurations are UTF-8")?))
}

/// Names of the examples of docs/your-task.md.
pub(crate) fn examples() -> impl Iterator<Item = &'static str> {
    FILES.iter().filter_map(|(path, _)| path.strip_prefix("configs/examples/")?.strip_suffix(".yaml"))
}

/// The policy file of a pilot, in fixed point.
pub(crate) fn pilot(name: &str) -> Option<&'static [u8]> {
    pilots().find(|(known, _)| *known == name).map(|(_, file)| file)
}

/// Names of pilots like an unknown one, for messages.
pub(crate) fn pilots_like(name: &str) -> String {
    offered(name, pilots().map(|(name, _)| name))
}

/// The experiment file of the task of this name; whatever else is there as it is.
///
/// # Errors
/// When a name is unknown, or the cache cannot be written.
pub(crate) fn task(path: &Path) -> Result<PathBuf> {
    let Some(name) = as_name(path) else { return Ok(path.to_owned()) };
    if let Some((_, file)) = tasks().find(|(known, _)| *known == name) {
        return Ok(unpacked()?.join(file));
    }
    if path.exists() {
        return Ok(path.to_owned());
    }
    let names = offered(name, tasks().map(|(name, _)| name));
    bail!("{name}: found neither a file nor a task of this name, expected one: {names}");
}

/// The file of this name in a folder of `configs`, such as `studies`; whatever else is there as it is.
///
/// # Errors
/// When a name is unknown, or the cache cannot be written.
pub(crate) fn configuration(folder: &str, path: &Path) -> Result<PathBuf> {
    let Some(name) = as_name(path) else { return Ok(path.to_owned()) };
    let names = || names_in(folder);
    if names().any(|known| known == name) {
        return Ok(unpacked()?.join("configs").join(folder).join(format!("{name}.yaml")));
    }
    if path.exists() {
        return Ok(path.to_owned());
    }
    bail!("{name}: found neither a file nor a shipped one of this name, expected one: {}", offered(name, names()));
}

/// The file of the aviary of this name: a world's, or a task's.
///
/// # Errors
/// As [`configuration`].
pub(crate) fn aviary(name: &str) -> Result<PathBuf> {
    let world = format!("assets/worlds/{name}.yaml");
    if FILES.iter().any(|(path, _)| *path == world) {
        return Ok(unpacked()?.join(world));
    }
    task(Path::new(name))
}

/// The directory of a run with the pilot of this name and its task; whatever else is there as it is.
///
/// # Errors
/// When a name is unknown, or the cache cannot be written.
pub(crate) fn run(path: &Path) -> Result<PathBuf> {
    let Some(name) = as_name(path) else { return Ok(path.to_owned()) };
    let Some(policy) = pilot(name) else {
        if path.exists() {
            return Ok(path.to_owned());
        }
        let names = pilots_like(name);
        bail!("{name}: found neither a run nor a policy file nor a pilot of this name, expected one: {names}");
    };
    let (_, task) = tasks().find(|(known, _)| *known == name).context("a pilot has the name of its task")?;
    let directory = unpacked()?.join("pilots").join(name);
    let up = "../".repeat(1 + name.split('/').count());
    let (_, last) = name.rsplit_once('/').unwrap_or(("", name));
    let config = format!("version: 1\nname: {last}\nimport: {up}{task}\n");
    keep(&RunDirectory::config_in(&directory), config.as_bytes())?;
    keep(&directory.join("policy.kestrel"), policy)?;
    Ok(directory)
}

/// The policy file at `path`, of the run there, or of the pilot of this name.
///
/// # Errors
/// As [`run`], and when a run has no policy.
pub(crate) fn policy(path: &Path) -> Result<PathBuf> {
    let path = run(path)?;
    if path.is_dir() { Ok(RunDirectory::open(&path)?.exported_policy()?) } else { Ok(path) }
}

/// The name, if neither a file nor a run is meant: what was exported before may lie in a folder of a pilot's name.
pub(crate) fn as_name(path: &Path) -> Option<&str> {
    let other = path.is_file() || path.extension().is_some() || RunDirectory::config_in(path).exists();
    path.to_str().filter(|_| !other && path.is_relative())
}

/// Names of the files in a folder of `configs`, such as `studies`.
pub(crate) fn names_in(folder: &str) -> impl Iterator<Item = &'static str> {
    let named = move |file: &'static str| {
        file.strip_prefix("configs/")?.strip_prefix(folder)?.strip_prefix('/')?.strip_suffix(".yaml")
    };
    FILES.iter().filter_map(move |(file, _)| named(file)).filter(|name| !name.contains('/'))
}

/// Names of the worlds.
pub(crate) fn worlds() -> impl Iterator<Item = &'static str> {
    FILES.iter().filter_map(|(path, _)| path.strip_prefix("assets/worlds/")?.strip_suffix(".yaml"))
}

/// Pilots by name.
pub(crate) fn pilots() -> impl Iterator<Item = (&'static str, &'static [u8])> {
    let file = |&(path, bytes): &(&'static str, &'static [u8])| {
        Some((path.strip_prefix("assets/pilots/")?.strip_suffix(".kestrel")?, bytes))
    };
    FILES.iter().filter_map(file)
}

/// Tasks by name, and their files; an aviary whose name is taken is called `aviaries/NAME`. So does the Python package
/// (`_tasks.py`).
pub(crate) fn tasks() -> impl Iterator<Item = (&'static str, &'static str)> {
    FILES.iter().filter_map(|&(path, _)| {
        let name = path.strip_prefix("configs/")?.strip_suffix(".yaml")?;
        match name.rsplit_once('/') {
            None => Some((name, path)),
            Some(("aviaries", aviary)) => Some((if is_taken(aviary) { name } else { aviary }, path)),
            Some(("aviaries/stream", room)) => Some((room, path)),
            Some(_) => None,
        }
    })
}

/// Whether a task that is no aviary has this name.
fn is_taken(name: &str) -> bool {
    let file = format!("configs/{name}.yaml");
    FILES.iter().any(|(path, _)| *path == file)
}

/// Those of `names` that are most like `name`; where none is, the usual ones or the first; and a sign that there are more.
fn offered<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> String {
    let all: Vec<&str> = names.collect();
    let mut alike: Vec<(f64, &str)> =
        all.iter().map(|known| (strsim::jaro_winkler(name, known), *known)).collect();
    alike.retain(|(likeness, _)| *likeness > LIKENESS);
    alike.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    let usual = SOME.iter().all(|name| all.contains(name)).then_some(SOME);
    let offered: Vec<&str> = if alike.is_empty() {
        usual.map_or(all, |usual| usual.to_vec()).into_iter().take(SOME.len()).collect()
    } else {
        alike.iter().take(SOME.len()).map(|(_, name)| *name).collect()
    };
    format!("{}, …", offered.join(", "))
}

/// All files, in the user's cache.
fn unpacked() -> Result<PathBuf> {
    let cache = cache().join("kestrel").join(env!("CARGO_PKG_VERSION"));
    for (name, contents) in FILES.iter().filter(|(name, _)| !name.starts_with("assets/pilots/")) {
        keep(&cache.join(name), contents)?;
    }
    Ok(cache)
}

/// Makes `contents` those of the file, if they are not.
fn keep(path: &Path, contents: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|found| found == contents) {
        return Ok(());
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    }
    Ok(write_atomically(path, contents)?)
}

/// Where programs keep what they can make again.
fn cache() -> PathBuf {
    let folder = |name| env::var_os(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
    folder("XDG_CACHE_HOME")
        .or_else(|| folder("HOME").map(|home| home.join(".cache")))
        .or_else(|| folder("LOCALAPPDATA"))
        .unwrap_or_else(env::temp_dir)
}

#[cfg(test)]
mod tests {
    use kestrel_core::policy_file::PolicyAirframe;
    use kestrel_experiments::run_config::RunConfig;
    use kestrel_export::policy::Policy;
    use kestrel_shim::policy_bytes::PolicyBytes;

    use super::*;

    #[test]
    fn every_pilot_has_the_drone_of_its_task() {
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        for (name, file) in pilots() {
            let (_, task) = tasks().find(|(task, _)| *task == name).unwrap();
            let config = RunConfig::load(&repository.join(task), &[]).unwrap();
            let file = PolicyBytes::copy_of(file);
            let policy = Policy::parse(file.bytes()).unwrap();
            let drone = PolicyAirframe::from(&config.task(None).unwrap().scenario.airframe);
            assert_eq!(policy.metadata().airframe, Some(drone), "{name}");
            policy.self_test().unwrap();
        }
    }

    #[test]
    fn names_are_those_of_files_and_of_no_folder() {
        let task = |name| tasks().find(|(known, _)| *known == name).map(|(_, file)| file);
        assert_eq!(task("hover"), Some("configs/hover.yaml"));
        assert_eq!(task("aviaries/hover"), Some("configs/aviaries/hover.yaml"));
        assert_eq!(task("room-1"), Some("configs/aviaries/room-1.yaml"));
        assert_eq!(task("stream-03"), Some("configs/aviaries/stream/stream-03.yaml"));
        assert_eq!([task("parts/a2c"), task("navigate"), task("aviaries/room-1")], [None; 3]);
    }

    #[test]
    fn the_most_alike_names_are_offered() {
        let names = || ["room-0", "room-1", "room-2", "land", "hover", "zebra"].into_iter();
        assert_eq!(offered("rom-1", names()), "room-1, room-0, room-2, …");
        assert_eq!(offered("zebro", names()), "zebra, …");
        assert_eq!(offered("xyz", names()), "hover, room-1, land, …");
        assert_eq!(offered("xyz", ["oak", "elm"].into_iter()), "oak, elm, …");
    }
}
