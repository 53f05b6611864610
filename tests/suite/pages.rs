//! The repository's pages: how wide they are, where their links lead, and that the book has all of them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Widest line of text; tables, code and pictures are as wide as they are.
const COLUMNS: usize = 100;

/// Longest first page and map.
const SHORT: [(&str, usize); 2] = [("README.md", 150), ("ARCHITECTURE.md", 150)];

/// Made by a command, which does not wrap.
const MADE: [&str; 2] = ["RESULTS.md", "docs/reference.md"];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Files of the repository that a pattern of git names, with those that are new.
fn listed(pattern: &str) -> Vec<String> {
    let listed = Command::new("git")
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard", pattern])
        .current_dir(repository())
        .output()
        .unwrap();
    let names = String::from_utf8(listed.stdout).unwrap();
    let names = names.split('\0').filter(|name| !name.is_empty() && repository().join(name).is_file());
    let names: Vec<String> = names.map(str::to_owned).collect();
    // Outside of a clone of the repository there would be nothing to look at, and everything right.
    assert!(!names.is_empty(), "git lists no {pattern} in {}", repository().display());
    names
}

/// Paths of all pages, and their texts.
fn pages() -> Vec<(String, String)> {
    let text = |name: String| (name.clone(), fs::read_to_string(repository().join(name)).unwrap());
    listed("*.md").into_iter().map(text).collect()
}

/// Lines outside of code blocks, with their numbers.
fn prose(text: &str) -> Vec<(usize, &str)> {
    let mut inside = false;
    let mut lines = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let fence = line.trim_start().starts_with("```");
        if !fence && !inside {
            lines.push((index + 1, line));
        }
        inside ^= fence;
    }
    lines
}

/// Where the links of a line lead.
fn links(line: &str) -> impl Iterator<Item = &str> {
    line.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next())
}

/// Names by which links reach the headings of a page, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let heading = |(_, line): (usize, &str)| {
        let words = line.trim_start_matches('#');
        let words = words.strip_prefix(' ').filter(|_| line.starts_with('#'))?.to_lowercase();
        let kept = words.chars().filter(|letter| letter.is_alphanumeric() || [' ', '-', '_'].contains(letter));
        Some(kept.collect::<String>().replace(' ', "-"))
    };
    prose(text).into_iter().filter_map(heading).collect()
}

#[test]
fn lines_are_at_most_a_hundred_columns_wide() {
    let mut wide = Vec::new();
    for (name, text) in pages().iter().filter(|(name, _)| !MADE.contains(&name.as_str())) {
        let lines = prose(text).into_iter().filter(|(_, line)| !line.starts_with(['|', '!']));
        let lines = lines.filter(|(_, line)| line.chars().count() > COLUMNS && line.contains(' '));
        wide.extend(lines.map(|(number, _)| format!("{name}:{number}")));
    }
    assert!(wide.is_empty(), "{wide:#?}");
    for (name, limit) in SHORT {
        let lines = fs::read_to_string(repository().join(name)).unwrap().lines().count();
        assert!(lines <= limit, "{name} has {lines} lines, {limit} at most");
    }
}

#[test]
fn links_lead_to_files_and_headings() {
    let mut broken = Vec::new();
    for (name, text) in pages() {
        let here = repository().join(&name);
        for (number, link) in
            prose(&text).into_iter().flat_map(|(number, line)| links(line).map(move |link| (number, link)))
        {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { here.clone() } else { here.parent().unwrap().join(path) };
            let reached = target.exists()
                && (anchor.is_empty()
                    || target.extension().is_none_or(|ending| ending != "md")
                    || anchors(&fs::read_to_string(&target).unwrap()).contains(anchor));
            if !reached {
                broken.push(format!("{name}:{number}: {link}"));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn the_book_has_every_page() {
    let summary = fs::read_to_string(repository().join("docs/SUMMARY.md")).unwrap();
    let named: BTreeSet<PathBuf> = summary
        .lines()
        .flat_map(links)
        .map(|link| repository().join("docs").join(link).canonicalize().unwrap())
        .collect();
    let left_out = |(name, _): (String, String)| {
        let of_docs = name.starts_with("docs/") && name != "docs/SUMMARY.md";
        let path = repository().join(&name).canonicalize().unwrap();
        (of_docs && !named.contains(&path)).then_some(name)
    };
    let left_out: Vec<String> = pages().into_iter().filter_map(left_out).collect();
    assert!(left_out.is_empty(), "{left_out:?}");
}

#[test]
fn every_example_is_on_its_page() {
    let page = fs::read_to_string(repository().join("docs/examples.md")).unwrap();
    let missing = |path: &str| -> Option<String> {
        let (_, file) = path.rsplit_once('/')?;
        let (name, ending) = file.rsplit_once('.')?;
        let named = match ending {
            "yaml" => page.contains(&format!("](pictures/examples/{name}.gif)<br>`{name}`")),
            "rs" => page.contains(&format!("--example {name}`")) || page.contains(&format!("`{name}`")),
            "py" | "ipynb" => page.contains(path),
            _ => true,
        };
        (!named).then(|| path.to_owned())
    };
    let missing: Vec<String> = listed(":(glob)**/examples/*").iter().filter_map(|path| missing(path)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}
