//! A drawing as SVG.

use std::fmt::Write;

use super::{Anchor, Colour, Dashed, Drawing, Mark, Pen, Text};

const FONT: &str = "Helvetica Neue, Helvetica, Arial, sans-serif";

impl Drawing {
    /// The drawing as an SVG document.
    pub fn svg(&self) -> String {
        let [width, height] = [self.width, self.height].map(number);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"{FONT}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        );
        for mark in &self.marks {
            svg += &element(mark);
            svg.push('\n');
        }
        svg + "</svg>\n"
    }
}

fn element(mark: &Mark) -> String {
    match mark {
        Mark::Polygon { corners, fill, edge } => {
            format!("<polygon points=\"{}\"{}/>", pairs(corners), style(*fill, *edge))
        }
        Mark::Line { ends: [[x1, y1], [x2, y2]], pen } => {
            let [x1, y1, x2, y2] = [x1, y1, x2, y2].map(|value| number(*value));
            format!("<line x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\"{}/>", stroke(pen))
        }
        Mark::Path { points, pen } => {
            format!(
                "<polyline points=\"{}\" fill=\"none\" stroke-linejoin=\"round\"{}/>",
                pairs(points),
                stroke(pen)
            )
        }
        Mark::Disc { centre: [x, y], radius, fill, edge } => {
            let [x, y, radius] = [x, y, radius].map(|value| number(*value));
            format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\"{}/>", style(*fill, *edge))
        }
        Mark::Text(text) => words(text),
    }
}

fn pairs(points: &[[f64; 2]]) -> String {
    points.iter().map(|[x, y]| format!("{},{}", number(*x), number(*y))).collect::<Vec<_>>().join(" ")
}

fn style(fill: Option<(Colour, f64)>, edge: Option<Pen>) -> String {
    let mut style = match fill {
        None => " fill=\"none\"".to_owned(),
        Some((colour, opacity)) if opacity >= 1.0 => format!(" fill=\"{}\"", hexadecimal(colour)),
        Some((colour, opacity)) => {
            format!(" fill=\"{}\" fill-opacity=\"{}\"", hexadecimal(colour), number(opacity))
        }
    };
    if let Some(pen) = edge {
        style += &stroke(&pen);
    }
    style
}

fn stroke(pen: &Pen) -> String {
    let mut stroke = format!(" stroke=\"{}\" stroke-width=\"{}\"", hexadecimal(pen.colour), number(pen.width));
    if pen.dashed == Dashed::Dashes {
        stroke += " stroke-dasharray=\"4 3\"";
    }
    stroke
}

fn words(text: &Text) -> String {
    let anchor = match text.anchor {
        Anchor::Start => "",
        Anchor::Middle => " text-anchor=\"middle\"",
        Anchor::End => " text-anchor=\"end\"",
    };
    let [x, y, size] = [text.at[0], text.at[1], text.size].map(number);
    let fill = hexadecimal(text.colour);
    format!(
        "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" fill=\"{fill}\"{anchor}>{}</text>",
        escaped(&text.words)
    )
}

fn escaped(words: &str) -> String {
    words.chars().filter(|letter| !letter.is_control()).fold(String::new(), |mut text, letter| {
        match letter {
            '&' => text += "&amp;",
            '<' => text += "&lt;",
            '>' => text += "&gt;",
            other => text.push(other),
        }
        text
    })
}

fn hexadecimal(Colour(colour): Colour) -> String {
    colour.iter().fold("#".to_owned(), |mut text, share| {
        write!(text, "{share:02x}").expect("a string takes all that is written to it");
        text
    })
}

/// With a tenth of a pixel, hundredths below ten.
fn number(value: f64) -> String {
    let text = if value.abs() < 10.0 { format!("{value:.2}") } else { format!("{value:.1}") };
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}
