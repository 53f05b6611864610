//! What is written: a world file and the task that imports it.

use std::fmt::Write;
use std::path::{Component, Path, PathBuf};

use kestrel_sim::rooms::{Kind, Piece, ROOM, STARTS, WALL_COLOUR, WALL_M};

use super::{FURNITURE, Room, TABLE};

/// How a file names others: paths from its own folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Folder of furniture, with a slash at its end.
    furniture: String,
    /// What tasks import.
    base: String,
    /// The world file.
    world: String,
}

impl Layout {
    /// For a file in `folder`.
    pub(crate) fn from(folder: &Path, furniture: &Path, base: &Path, world: &Path) -> Self {
        let path = |target: &Path| relative(folder, target);
        Self { furniture: format!("{}/", path(furniture)), base: path(base), world: path(world) }
    }
}

/// The files of one room.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Manuscript<'a> {
    /// The room.
    pub(crate) name: &'a str,
    /// The command that makes it.
    pub(crate) command: &'a str,
    /// Of the file that is written.
    pub(crate) layout: &'a Layout,
}

impl Manuscript<'_> {
    /// The world file.
    pub(super) fn world(&self, room: &Room) -> String {
        let pieces = room.plan.pieces.len() - 1;
        format!(
            "# Written by: {}\n\nabout: a random room with {pieces} things between the start and a table ({})\n{}",
            self.command,
            self.name,
            contents(room, &self.layout.furniture)
        )
    }

    /// The task, which imports the world file.
    pub(super) fn task(&self) -> String {
        format!("{}  aviary: {{ import: {} }}\n", self.head(), self.layout.world)
    }

    /// The task with the world in it.
    pub(super) fn whole_task(&self, room: &Room) -> String {
        let mut text = format!("{}  aviary:\n", self.head());
        for line in contents(room, &self.layout.furniture).lines() {
            writeln!(text, "    {line}").expect("strings take all text");
        }
        text
    }

    fn head(&self) -> String {
        let Self { name, command, layout } = self;
        format!("# Written by: {command}\n\nversion: 1\nname: {name}\nimport: {}\nscenario:\n", layout.base)
    }
}

/// The keys of a world file but `about`; `folder` is what furniture's names stand behind.
pub(super) fn contents(room: &Room, folder: &str) -> String {
    let start = (STARTS.low + STARTS.high) / 2.0;
    let start = [start.x, start.y, 0.5].map(|metres| (f64::from(metres) * 100.0).round() / 100.0);
    let route: Vec<String> = room.route.iter().map(point).collect();
    let [low, high] = [ROOM.low, ROOM.high].map(|corner| point(&corner.cast::<f64>().into()));
    let mut text = format!("goal_m: {}\nstarts_m: [{}]\n", point(&room.plan.goal), point(&start));
    if !route.is_empty() {
        writeln!(text, "route_m: [{}]", route.join(", ")).expect("strings take all text");
    }
    let [r, g, b] = WALL_COLOUR;
    writeln!(text, "room: {{ low_m: {low}, high_m: {high}, wall_m: {WALL_M}, colour: [{r}, {g}, {b}] }}")
        .expect("strings take all text");
    text + &furnishing(&room.plan.pieces, folder)
}

/// The keys that say what stands there.
pub(super) fn furnishing(pieces: &[Piece], folder: &str) -> String {
    let lines = |key: &str, of: &dyn Fn(&Piece) -> Option<String>| {
        let entries: Vec<String> = pieces.iter().filter_map(of).map(|entry| format!("  - {entry}\n")).collect();
        if entries.is_empty() { String::new() } else { format!("{key}:\n{}", entries.concat()) }
    };
    let furniture = lines("furniture", &|piece| imported(piece, folder));
    let partitions = lines("solids", &partition);
    furniture + &partitions + &lines("pillars", &pillar)
}

fn imported(Piece { kind, at: [x, y, z] }: &Piece, folder: &str) -> Option<String> {
    match kind {
        Kind::Table => Some(format!(
            "{{ import: {folder}{TABLE}.yaml, name: goal table, at_m: [{x}, {y}, {z}], role: landing }}"
        )),
        Kind::Furniture { model, yaw_deg, scale } => Some(format!(
            "{{ import: {folder}{}.yaml, at_m: [{x}, {y}, {z}], yaw_deg: {yaw_deg}, scale: {scale} }}",
            FURNITURE[*model].0
        )),
        Kind::Pillar | Kind::Partition { .. } => None,
    }
}

fn partition(Piece { kind, at: [x, y, _] }: &Piece) -> Option<String> {
    match kind {
        Kind::Partition { thickness_m, width_m, yaw_deg } => {
            let height = ROOM.high.z;
            let size = format!("[{thickness_m}, {width_m}, {height}]");
            let center = format!("[{x}, {y}, {}]", height / 2.0);
            Some(format!(
                "{{ name: partition, box: {{ center_m: {center}, size_m: {size}, rpy_deg: [0, 0, {yaw_deg}] }} }}"
            ))
        }
        Kind::Table | Kind::Furniture { .. } | Kind::Pillar => None,
    }
}

fn pillar(Piece { kind, at: [x, y, _] }: &Piece) -> Option<String> {
    (*kind == Kind::Pillar).then(|| format!("[{x}, {y}]"))
}

/// `[x, y, z]`.
pub(crate) fn point([x, y, z]: &[f64; 3]) -> String {
    format!("[{x}, {y}, {z}]")
}

/// The path of `target` from `folder`, with slashes; neither needs to exist.
pub(crate) fn relative(folder: &Path, target: &Path) -> String {
    let (folder, target) = (plain(folder), plain(target));
    let shared = folder.components().zip(target.components()).take_while(|(one, other)| one == other).count();
    let up = folder.components().skip(shared).map(|_| "..".to_owned());
    let down = target.components().skip(shared).map(|part| part.as_os_str().to_string_lossy().into_owned());
    let parts: Vec<String> = up.chain(down).collect();
    if parts.is_empty() { ".".to_owned() } else { parts.join("/") }
}

/// An absolute path without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut plain = PathBuf::new();
    for part in absolute.components() {
        match part {
            Component::ParentDir => {
                plain.pop();
            }
            Component::CurDir => {}
            Component::Prefix(_) | Component::RootDir | Component::Normal(_) => plain.push(part),
        }
    }
    plain
}
