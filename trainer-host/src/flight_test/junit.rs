//! Results in the format that continuous integration reads: `JUnit`'s XML.

use std::fmt::Write;

use super::runner::Verdict;

/// The report of some flights: a suite for every file. Times are simulated, so that the same flights give the same bytes.
pub(crate) fn report(verdicts: &[Verdict]) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(text, "<testsuites name=\"kestrel test\" {}>", sums(verdicts));
    for suite in verdicts.chunk_by(|one, other| one.suite == other.suite) {
        let Some(first) = suite.first() else { continue };
        let _ = writeln!(text, "  <testsuite name=\"{}\" {}>", escaped(&first.suite), sums(suite));
        for verdict in suite {
            write_case(&mut text, verdict);
        }
        text.push_str("  </testsuite>\n");
    }
    text.push_str("</testsuites>\n");
    text
}

fn write_case(text: &mut String, verdict: &Verdict) {
    let (suite, name) = (escaped(&verdict.suite), escaped(&verdict.name));
    let _ = writeln!(text, "    <testcase classname=\"{suite}\" name=\"{name}\" time=\"{:.3}\">", verdict.secs);
    if let Some(first) = verdict.failures.first() {
        let all: Vec<String> = verdict.failures.iter().map(ToString::to_string).collect();
        let (kind, message, all) = (first.name, escaped(&first.to_string()), escaped(&all.join("\n")));
        let _ = writeln!(text, "      <failure type=\"{kind}\" message=\"{message}\">{all}</failure>");
    }
    let mut words = vec![format!("hash {:016x}", verdict.hash)];
    words.extend(verdict.heard.iter().cloned());
    let _ = writeln!(text, "      <system-out>{}</system-out>", escaped(&words.join("\n")));
    text.push_str("    </testcase>\n");
}

/// Attributes of a group.
fn sums(verdicts: &[Verdict]) -> String {
    let failed = verdicts.iter().filter(|verdict| !verdict.failures.is_empty()).count();
    let secs: f64 = verdicts.iter().map(|verdict| verdict.secs).sum();
    format!("tests=\"{}\" failures=\"{failed}\" errors=\"0\" time=\"{secs:.3}\"", verdicts.len())
}

/// Text between tags and in attributes.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\n' | '\t' => escaped.push(letter),
            letter if letter.is_control() => escaped.push('\u{fffd}'),
            letter => escaped.push(letter),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight_test::expectation::Failure;

    fn verdict(suite: &str, name: &str, failures: Vec<Failure>) -> Verdict {
        Verdict {
            suite: suite.to_owned(),
            name: name.to_owned(),
            secs: 2.5,
            hash: 0x0123_4567_89ab_cdef,
            failures,
            heard: vec!["1.00 s: \"landed\" & more".to_owned()],
        }
    }

    #[test]
    fn what_is_written_is_read_back() {
        let failure = Failure {
            name: "stays_above",
            secs: 1.5,
            found: "a height of <0.1> m".to_owned(),
            expected: "at least \"0.3\" m\u{1}".to_owned(),
        };
        let verdicts = [
            verdict("a & b", "one", vec![]),
            verdict("a & b", "two [0.5 m]", vec![failure.clone()]),
            verdict("c", "three", vec![]),
        ];
        let text = report(&verdicts);
        let document = roxmltree::Document::parse(&text).unwrap();
        let root = document.root_element();
        let attribute = |node: roxmltree::Node<'_, '_>, name: &str| node.attribute(name).unwrap().to_owned();
        assert_eq!((attribute(root, "tests"), attribute(root, "failures")), ("3".to_owned(), "1".to_owned()));
        assert_eq!(attribute(root, "time"), "7.500");
        let suites: Vec<_> = root.children().filter(roxmltree::Node::is_element).collect();
        assert_eq!(suites.iter().map(|suite| attribute(*suite, "name")).collect::<Vec<_>>(), ["a & b", "c"]);
        let cases: Vec<_> = document.descendants().filter(|node| node.has_tag_name("testcase")).collect();
        let names: Vec<_> = cases.iter().map(|case| attribute(*case, "name")).collect();
        assert_eq!(names, ["one", "two [0.5 m]", "three"]);
        let failed: Vec<_> = document.descendants().filter(|node| node.has_tag_name("failure")).collect();
        let [failed] = failed[..] else { panic!("{text}") };
        assert_eq!(attribute(failed, "message"), failure.to_string().replace('\u{1}', "\u{fffd}"));
        assert_eq!(failed.parent().unwrap().attribute("name"), Some("two [0.5 m]"));
        let words = cases[0].children().find(|node| node.has_tag_name("system-out")).unwrap().text().unwrap();
        assert_eq!(words, "hash 0123456789abcdef\n1.00 s: \"landed\" & more");
    }
}
