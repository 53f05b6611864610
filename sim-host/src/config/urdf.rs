//! Airframes from URDF files in the form of gym-pybullet-drones.
//!
//! Such a file holds `properties` of the rotors and the air beside the links `base_link` (mass, inertia, collision
//! cylinder) and `prop0_link` to `prop3_link` (where the rotors are). It becomes the tree that the YAML form of the
//! airframe would have, every value at the place of the attribute that it comes from: the rest of the program cannot
//! tell the two apart.

use std::sync::Arc;

use kestrel_config::ConfigError;
use kestrel_config::error::{Place, Source};
use kestrel_config::node::{Entry, Node, Value};
use kestrel_core::airframe::GRAVITY;
use roxmltree::{Attribute, Document as Xml};

/// What a file of this form is expected to have.
const FORM: &str = "a URDF in gym-pybullet-drones' form";

/// Greatest distance of a rotor from where its symmetry puts it, relative to its own distance from the centre.
const SYMMETRY: f64 = 1e-6;

/// Angles below this are none \[rad\].
const NO_ANGLE: f64 = 1e-9;

/// The airframe in `text`, all of `source`.
pub(super) fn tree(source: &Arc<Source>, text: &str) -> Result<Node, ConfigError> {
    let xml = Xml::parse(text).map_err(|error| {
        let position = error.pos();
        let place =
            Place { source: Arc::clone(source), line: position.row as usize, column: position.col as usize };
        let said = error.to_string();
        let said = said.rsplit_once(" at ").map_or(said.as_str(), |(said, _)| said);
        ConfigError::at(&place, "", format_args!("a syntax error ({said})"), "valid XML")
    })?;
    Reader { source, xml: &xml }.airframe()
}

/// An element of the file.
#[derive(Clone, Copy)]
struct Element<'a>(roxmltree::Node<'a, 'a>);

struct Reader<'a> {
    source: &'a Arc<Source>,
    xml: &'a Xml<'a>,
}

/// A number and where it stands.
#[derive(Clone)]
struct Number {
    value: f64,
    place: Place,
}

impl<'a> Reader<'a> {
    fn airframe(&self) -> Result<Node, ConfigError> {
        let robot = Element(self.xml.root_element());
        if robot.0.tag_name().name() != "robot" {
            return Err(self.refuse(robot, format_args!("<{}>", robot.0.tag_name().name()), FORM));
        }
        let properties = self.child(robot, "properties")?;
        let base = self.link(robot, "base_link")?;
        let inertial = self.child(base, "inertial")?;
        self.at_centre(inertial)?;
        let mass = self.number(self.child(inertial, "mass")?, "value")?;
        let (layout, order) = self.layout(robot)?;
        let property = |name: &str| self.number(properties, name);
        let speed = Number {
            value: (property("thrust2weight")?.value * mass.value * GRAVITY / (4.0 * property("kf")?.value))
                .sqrt(),
            ..property("thrust2weight")?
        };
        let place = self.place(robot.0.range().start);
        Ok(mapping(
            &place,
            vec![
                ("mass_kg", mass.node()),
                ("inertia_kg_m2", self.inertia(inertial)?),
                ("layout", layout),
                ("rotor_order", order),
                ("arm_m", property("arm")?.node()),
                ("thrust_n_per_rpm2", property("kf")?.node()),
                ("torque_nm_per_rpm2", property("km")?.node()),
                ("rotor_speed_limit_rpm", speed.node()),
                ("drag_planar_kg_per_rad", property("drag_coeff_xy")?.node()),
                ("drag_axial_kg_per_rad", property("drag_coeff_z")?.node()),
                ("propeller_radius_m", property("prop_radius")?.node()),
                ("ground_effect_coefficient", property("gnd_eff_coeff")?.node()),
                ("downwash", self.downwash(properties)?),
                ("collision", self.collision(base)?),
                ("nominal_speed_km_per_h", property("max_speed_kmh")?.node()),
            ],
        ))
    }

    fn downwash(&self, properties: Element<'a>) -> Result<Node, ConfigError> {
        let strength = self.number(properties, "dw_coeff_1")?;
        let place = strength.place.clone();
        let entries = vec![
            ("strength_n", strength.node()),
            ("width_slope", self.number(properties, "dw_coeff_2")?.node()),
            ("width_offset_m", self.number(properties, "dw_coeff_3")?.node()),
        ];
        Ok(mapping(&place, entries))
    }

    /// The principal moments; products of inertia are not simulated.
    fn inertia(&self, inertial: Element<'a>) -> Result<Node, ConfigError> {
        let inertia = self.child(inertial, "inertia")?;
        for name in ["ixy", "ixz", "iyz"] {
            let product = self.number(inertia, name)?;
            if product.value != 0.0 {
                let expected = "0: body axes that are the principal axes of inertia";
                return Err(ConfigError::at(&product.place, name, product.value, expected));
            }
        }
        let moments = ["ixx", "iyy", "izz"].map(|name| self.number(inertia, name).map(Number::node));
        let [x, y, z] = moments;
        let place = self.place(inertia.0.range().start);
        Ok(node(Value::List(vec![x?, y?, z?]), &place))
    }

    /// The upright cylinder of the base.
    fn collision(&self, base: Element<'a>) -> Result<Node, ConfigError> {
        let collision = self.child(base, "collision")?;
        let cylinder = self.child(self.child(collision, "geometry")?, "cylinder")?;
        let (offset, place) = match first_child(collision, "origin") {
            Some(origin) => self.origin(origin)?,
            None => ([0.0; 3], self.place(collision.0.range().start)),
        };
        let [x, y, z] = offset;
        if x != 0.0 || y != 0.0 {
            let found = format!("a cylinder at {x} {y} {z}");
            return Err(ConfigError::at(&place, "xyz", found, "one above or below the centre of mass"));
        }
        let entries = vec![
            ("radius_m", self.number(cylinder, "radius")?.node()),
            ("height_m", self.number(cylinder, "length")?.node()),
            ("offset_m", Number { value: z, place: place.clone() }.node()),
        ];
        Ok(mapping(&place, entries))
    }

    /// Layout and numbering of the four rotors.
    fn layout(&self, robot: Element<'a>) -> Result<(Node, Node), ConfigError> {
        let mut rotors = Vec::with_capacity(4);
        for index in 0..4 {
            rotors.push(self.rotor(robot, index)?);
        }
        let first = rotors[0].1.clone();
        let text = |word: &str| node(Value::Text(word.to_owned()), &first);
        let number = |value: f64| Number { value, place: first.clone() }.node();
        let [x, y] = rotors[0].0.map(f64::abs);
        for (word, side) in [("clockwise", 1.0), ("counter_clockwise", -1.0)] {
            let cross = [[x, -side * y], [-x, -side * y], [-x, side * y], [x, side * y]];
            let plus = [[x, 0.0], [0.0, -side * x], [-x, 0.0], [0.0, side * x]];
            if x > 0.0 && y > 0.0 && agree(&rotors, &cross) {
                let lengths = mapping(&first, vec![("x_m", number(x)), ("y_m", number(y))]);
                return Ok((mapping(&first, vec![("cross", lengths)]), text(word)));
            }
            if agree(&rotors, &plus) {
                let lengths = mapping(&first, vec![("arm_m", number(x))]);
                return Ok((mapping(&first, vec![("plus", lengths)]), text(word)));
            }
        }
        let shown: Vec<String> = rotors.iter().map(|([x, y], _)| format!("({x}, {y})")).collect();
        let expected = "a symmetric cross or plus, numbered round from the front";
        Err(ConfigError::at(&first, "", format_args!("rotors at {}", shown.join(", ")), expected))
    }

    /// Where a rotor is in the body plane \[m\]: the origin of its joint and that of its inertia, added up.
    fn rotor(&self, robot: Element<'a>, index: usize) -> Result<([f64; 2], Place), ConfigError> {
        let name = format!("prop{index}_link");
        let link = self.link(robot, &name)?;
        let inertial = first_child(link, "inertial").and_then(|it| first_child(it, "origin"));
        let mut sum = [0.0; 3];
        let mut place = self.place(link.0.range().start);
        for origin in [joint_origin(robot, &name), inertial].into_iter().flatten() {
            let (offset, at) = self.origin(origin)?;
            place = at;
            for (total, part) in sum.iter_mut().zip(offset) {
                *total += part;
            }
        }
        let [x, y, z] = sum;
        if z != 0.0 {
            return Err(ConfigError::at(
                &place,
                "xyz",
                format_args!("a rotor at height {z}"),
                "0: in the body plane",
            ));
        }
        Ok(([x, y], place))
    }

    /// A translation \[m\]; there must be no rotation.
    fn origin(&self, origin: Element<'a>) -> Result<([f64; 3], Place), ConfigError> {
        let (xyz, place) = self.triple(origin, "xyz")?;
        if origin.0.attribute("rpy").is_some() {
            let (rpy, place) = self.triple(origin, "rpy")?;
            if rpy.iter().any(|angle| angle.abs() > NO_ANGLE) {
                return Err(ConfigError::at(&place, "rpy", format_args!("{rpy:?}"), "no rotation"));
            }
        }
        Ok((xyz, place))
    }

    /// Refuses a centre of mass beside the origin of the base.
    fn at_centre(&self, inertial: Element<'a>) -> Result<(), ConfigError> {
        let Some(origin) = first_child(inertial, "origin") else { return Ok(()) };
        let (xyz, place) = self.origin(origin)?;
        if xyz == [0.0; 3] {
            return Ok(());
        }
        let found = format!("a centre of mass at {xyz:?}");
        Err(ConfigError::at(&place, "xyz", found, "0 0 0: the origin of base_link"))
    }

    fn triple(&self, element: Element<'a>, name: &str) -> Result<([f64; 3], Place), ConfigError> {
        let (attribute, place) = self.attribute(element, name)?;
        let numbers: Vec<f64> = attribute.value().split_whitespace().filter_map(finite).collect();
        match <[f64; 3]>::try_from(numbers.as_slice()) {
            Ok(numbers) if attribute.value().split_whitespace().count() == 3 => Ok((numbers, place)),
            Ok(_) | Err(_) => {
                Err(ConfigError::at(&place, name, format_args!("{:?}", attribute.value()), "three numbers"))
            }
        }
    }

    fn number(&self, element: Element<'a>, name: &str) -> Result<Number, ConfigError> {
        let (attribute, place) = self.attribute(element, name)?;
        match finite(attribute.value().trim()) {
            Some(value) => Ok(Number { value, place }),
            None => Err(ConfigError::at(&place, name, format_args!("{:?}", attribute.value()), "a number")),
        }
    }

    fn attribute(&self, element: Element<'a>, name: &str) -> Result<(Attribute<'a, 'a>, Place), ConfigError> {
        let named = element.0.attributes().find(|attribute| attribute.name() == name);
        named.map(|attribute| (attribute, self.place(attribute.range_value().start))).ok_or_else(|| {
            let tag = element.0.tag_name().name();
            self.refuse(element, format_args!("<{tag}> without `{name}`"), FORM)
        })
    }

    fn child(&self, parent: Element<'a>, name: &str) -> Result<Element<'a>, ConfigError> {
        first_child(parent, name).ok_or_else(|| {
            self.refuse(parent, format_args!("<{}> without <{name}>", parent.0.tag_name().name()), FORM)
        })
    }

    fn link(&self, robot: Element<'a>, name: &str) -> Result<Element<'a>, ConfigError> {
        children(robot, "link")
            .find(|link| link.0.attribute("name") == Some(name))
            .ok_or_else(|| self.refuse(robot, format_args!("no link `{name}`"), FORM))
    }

    fn refuse(&self, element: Element<'a>, found: impl std::fmt::Display, expected: &str) -> ConfigError {
        ConfigError::at(&self.place(element.0.range().start), "", found, expected)
    }

    fn place(&self, offset: usize) -> Place {
        let position = self.xml.text_pos_at(offset);
        Place { source: Arc::clone(self.source), line: position.row as usize, column: position.col as usize }
    }
}

/// The origin of the joint that carries a link.
fn joint_origin<'a>(robot: Element<'a>, link: &str) -> Option<Element<'a>> {
    let carries = |joint: &Element<'a>| {
        let child = first_child(*joint, "child");
        child.and_then(|child| child.0.attribute("link")) == Some(link)
    };
    let joint = children(robot, "joint").find(carries)?;
    first_child(joint, "origin")
}

fn first_child<'a>(parent: Element<'a>, name: &str) -> Option<Element<'a>> {
    children(parent, name).next()
}

fn children<'a>(parent: Element<'a>, name: &str) -> impl Iterator<Item = Element<'a>> {
    parent.0.children().filter(move |child| child.has_tag_name(name)).map(Element)
}

fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

/// Whether the rotors are where a layout has them.
fn agree(rotors: &[([f64; 2], Place)], layout: &[[f64; 2]; 4]) -> bool {
    rotors.iter().zip(layout).all(|(([x, y], _), [expected_x, expected_y])| {
        (x - expected_x).hypot(y - expected_y) <= SYMMETRY * expected_x.hypot(*expected_y)
    })
}

fn node(value: Value, place: &Place) -> Node {
    Node { value, place: place.clone(), import: None }
}

fn mapping(place: &Place, entries: Vec<(&str, Node)>) -> Node {
    let entry = |(key, node): (&str, Node)| Entry::new(key.to_owned(), node.place.clone(), node);
    node(Value::Mapping(entries.into_iter().map(entry).collect()), place)
}

impl Number {
    fn node(self) -> Node {
        node(Value::Number(self.value, self.value.to_string()), &self.place)
    }
}
