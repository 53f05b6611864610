//! Frames of the reference's camera (`TinyRenderer`): what each pixel shows, its depth and its colour.
//!
//! A case `camera_SCENE` has `camera/SCENE.json` with the objects, the camera and the drone's poses, and three files of
//! pixels, frame after frame from the top left: `SCENE.rgba.u8.bin`, `SCENE.depth.f32.bin` (of the depth buffer, 0 at the
//! near plane and 1 at the far one) and `SCENE.seg.i32.bin` (bodies; −1 is nothing), little-endian. Pixels that show the
//! drone's own mesh are left out, and those of objects whose mesh the recording only names.

use std::path::{Path, PathBuf};

use kestrel_core::attitude::Attitude;
use kestrel_core::reference::euler::EulerAngles;
use kestrel_sim::camera::{Camera, FIRST_SOLID, FLOOR, Image, NOTHING, Scene, View};
use kestrel_sim::world::{Floor, Pose, Shape, Solid, World};
use nalgebra::Vector3;
use serde::Deserialize;

use super::error::RecordingError;
use super::file::bytes_of;
use super::index::{Case, Json, Part};
use super::motion::largest;
use super::report::{Kind, Ledger, Worst};
use super::table::{Columns, Table};

/// Levels by which a colour may differ from one in the light or in a shadow: the reference's spheres and cylinders are
/// faceted.
const COLOUR_LEVELS: f32 = 3.0;

/// Shares by which a depth may differ, and on a sphere: the reference's are coarse meshes inside of ours.
const DEPTH_SHARES: [f32; 2] = [0.01, 0.04];

/// Bits of a label that name the body; the link is above them.
const BODY_BITS: i32 = (1 << 24) - 1;

/// Farthest that a place may be \[m\].
const REACH: f64 = 1e6;

#[derive(Deserialize)]
struct Settings {
    frames: usize,
}

/// `SCENE.json`.
#[derive(Deserialize)]
struct Description {
    plane_body_id: Option<i32>,
    drone_body_id: i32,
    objects: Vec<Object>,
    visual_shapes: Vec<VisualShape>,
    poses: Vec<RecordedPose>,
    camera: Lens,
}

#[derive(Deserialize)]
struct Object {
    body_id: i32,
    position: [f64; 3],
    rpy: [f64; 3],
}

/// What `getVisualShapeData` says of a body.
#[derive(Deserialize)]
struct VisualShape {
    body: i32,
    #[serde(rename = "type")]
    kind: u8,
    dims: [f64; 3],
    file: String,
    rgba: [f32; 4],
}

#[derive(Deserialize)]
struct RecordedPose {
    position: [f64; 3],
    quat_xyzw: [f64; 4],
}

/// The camera, which sits at `L` above the drone's centre.
#[derive(Deserialize)]
struct Lens {
    #[serde(rename = "L")]
    height_m: f64,
    fov_deg: f64,
    aspect: f64,
    near: f64,
    far: f64,
    width: u16,
    height: u16,
}

/// What is in front of the camera.
struct Place {
    world: World,
    /// Body of the recording and what it is here; nothing for what is left out.
    bodies: Vec<(i32, Option<u16>)>,
    /// Solids whose colour is known.
    plain: Vec<bool>,
    /// Files of the meshes that are left out.
    left_out: Vec<String>,
}

/// The recorded pixels of one frame.
struct Frame {
    /// Along the optical axis \[m\].
    depths: Vec<f32>,
    /// As ours; nothing for what is left out.
    labels: Vec<Option<u16>>,
    colours: Vec<[u8; 3]>,
}

/// How many pixels of a frame were compared, and how many of them differ.
#[derive(Default)]
struct Count {
    pixels: usize,
    /// From every one of the nine around it in the recording.
    labels: usize,
    /// By more than [`DEPTH_SHARES`], where the label agrees.
    depths: usize,
    /// By more than [`COLOUR_LEVELS`], where the label agrees.
    colours: usize,
}

/// Compares a case.
pub(super) fn compare(folder: &Path, case: &Case<'_>, ledger: &mut Ledger) -> Result<(), RecordingError> {
    let Settings { frames } = case.part.decode()?;
    let scene = case.id.strip_prefix("camera_");
    let scene = scene.ok_or_else(|| case.part.refuse(format_args!("the id {}", case.id), "`camera_SCENE`"))?;
    let file = |end: &str| folder.join("camera").join(format!("{scene}.{end}"));
    let json = Json::read(&file("json"))?;
    let part = json.whole();
    let description: Description = part.decode()?;
    if description.poses.len() != frames {
        return Err(
            part.refuse(format_args!("{} poses", description.poses.len()), format_args!("{frames} frames"))
        );
    }
    let (camera, place) = (description.camera.camera(&part)?, description.place(&part)?);
    let recorded =
        description.frames(&camera, &place, ["rgba.u8.bin", "depth.f32.bin", "seg.i32.bin"].map(file))?;
    let (renderer, mut counts) = (Scene::new(&place.world), Vec::new());
    for (pose, frame) in description.poses.iter().zip(&recorded) {
        let view = View::paper(&pose.checked(&part)?, description.camera.height_m);
        counts.push(place.count(frame, &renderer.render(&camera, &view)));
    }
    for (kind, off) in [
        (Kind::CameraLabels, (|count| count.labels) as fn(&Count) -> usize),
        (Kind::CameraDepths, |count| count.depths),
        (Kind::CameraColours, |count| count.colours),
    ] {
        ledger.add(kind, &case.id, &share(&counts, off));
    }
    if !place.left_out.is_empty() {
        let meshes = place.left_out.join(", ");
        ledger.note(format!("{}: pixels of {meshes} are left out, of which the recording has no mesh", case.id));
    }
    Ok(())
}

/// What share of the pixels of all frames is off; the row is the frame that has most of them.
fn share(counts: &[Count], off: fn(&Count) -> usize) -> Worst {
    let pixels: usize = counts.iter().map(|count| count.pixels).sum();
    let error = counts.iter().map(off).sum::<usize>() as f64 / pixels.max(1) as f64;
    let most = (0..counts.len()).rev().max_by_key(|frame| off(&counts[*frame])).unwrap_or(0);
    Worst::of(counts.len(), error, format_args!("frame {most}"))
}

/// Compares `unit/camera_matrices.csv`: the view and the projection (OpenGL, columns first) from each pose.
pub(super) fn matrices(table: &Table) -> Result<Worst, RecordingError> {
    let pose: Columns<7> = table.columns(["px", "py", "pz", "qx", "qy", "qz", "qw"])?;
    let (view, projection) = (table.sixteen("v")?, table.sixteen("p")?);
    let mut worst = Worst::default();
    for row in table.rows() {
        let [x, y, z, qx, qy, qz, qw] = table.given(row, &pose)?;
        let pose = RecordedPose { position: [x, y, z], quat_xyzw: [qx, qy, qz, qw] };
        let pose = pose.pose().ok_or_else(|| table.refuse_row(row, "a pose that looks straight up", "another"))?;
        let seen = view_matrix(&View::paper(&pose, Camera::REFERENCE.near_m));
        let error = largest(&seen, &row.pick(&view))
            .max(largest(&projection_matrix(&Camera::REFERENCE), &row.pick(&projection)));
        worst.add(error, row.name());
    }
    Ok(worst)
}

fn view_matrix(view: &View) -> [f64; 16] {
    let axes = [view.right, -view.down, -view.forward];
    let column = |axis: usize| axes.map(|row| row[axis]);
    let shift = axes.map(|row| -row.dot(&view.eye));
    let mut matrix = [0.0; 16];
    for (index, three) in [column(0), column(1), column(2), shift].iter().enumerate() {
        matrix[4 * index..4 * index + 3].copy_from_slice(three);
    }
    matrix[15] = 1.0;
    matrix
}

fn projection_matrix(camera: &Camera) -> [f64; 16] {
    let (near, far) = (camera.near_m, camera.far_m);
    let mut matrix = [0.0; 16];
    matrix[0] = camera.tangents[0].recip();
    matrix[5] = camera.tangents[1].recip();
    matrix[10] = (far + near) / (near - far);
    matrix[11] = -1.0;
    matrix[14] = 2.0 * far * near / (near - far);
    matrix
}

impl Lens {
    fn camera(&self, part: &Part<'_>) -> Result<Camera, RecordingError> {
        let Self { fov_deg, aspect, near, far, width, height, height_m } = *self;
        let sees = fov_deg > 0.0 && fov_deg < 180.0 && aspect > 0.0 && 0.0 < near && near < far && far < REACH;
        if !sees || width == 0 || height == 0 || height_m.abs() > REACH {
            let found = format!("a camera of {width}x{height} pixels, {fov_deg} degrees, {near} to {far} m");
            return Err(part.refuse(found, "pixels, less than 180 degrees, and a far plane behind the near one"));
        }
        let tangent = libm::tan(0.5 * fov_deg.to_radians());
        Ok(Camera {
            columns: width.into(),
            rows: height.into(),
            tangents: [aspect * tangent, tangent],
            near_m: near,
            far_m: far,
            ..Camera::REFERENCE
        })
    }
}

impl RecordedPose {
    /// None if it is no pose, or one from which up is ahead.
    fn pose(&self) -> Option<Pose> {
        let [x, y, z, w] = self.quat_xyzw;
        let pose = Pose { position: self.position.into(), world_from_body: Attitude { w, x, y, z } };
        let ahead = pose.world_from_body.rotate(Vector3::x());
        let unit = (x * x + y * y + z * z + w * w - 1.0).abs() < 1e-6;
        (unit && pose.position.amax() < REACH && ahead.x.hypot(ahead.y) > 1e-3).then_some(pose)
    }

    fn checked(&self, part: &Part<'_>) -> Result<Pose, RecordingError> {
        let found = || format!("the pose {:?}, {:?}", self.position, self.quat_xyzw);
        self.pose().ok_or_else(|| part.refuse(found(), "a unit quaternion that does not look straight up"))
    }
}

impl Description {
    /// The world of the objects.
    fn place(&self, part: &Part<'_>) -> Result<Place, RecordingError> {
        let floor = if self.plane_body_id.is_some() { Floor::Solid } else { Floor::Absent };
        let mut place = Place {
            world: World { floor, ..World::empty() },
            bodies: vec![(-1, Some(NOTHING)), (self.drone_body_id, None)],
            plain: Vec::new(),
            left_out: Vec::new(),
        };
        place.bodies.extend(self.plane_body_id.map(|body| (body, Some(FLOOR))));
        for object in &self.objects {
            let looks: Vec<&VisualShape> =
                self.visual_shapes.iter().filter(|look| look.body == object.body_id).collect();
            let [look] = looks[..] else {
                let found = format!("{} visual shapes of body {}", looks.len(), object.body_id);
                return Err(part.refuse(found, "one"));
            };
            place.add(object, look).ok_or_else(|| {
                let found = format!("body {} of type {} and {:?} m", look.body, look.kind, look.dims);
                part.refuse(found, "a sphere (2), box (3), cylinder (4) or mesh (5) with a size, where it can be")
            })?;
        }
        Ok(place)
    }

    /// The recorded frames, from the files of their colours, depths and labels.
    fn frames(
        &self,
        camera: &Camera,
        place: &Place,
        [colours, depths, labels]: [PathBuf; 3],
    ) -> Result<Vec<Frame>, RecordingError> {
        let pixels = camera.columns * camera.rows;
        let read = |path: &Path| pixels_of(path, self.poses.len() * pixels);
        let (colours, depths, bodies) = (read(&colours)?, read(&depths)?, read(&labels)?);
        let (near, far) = (camera.near_m, camera.far_m);
        let depth =
            |bytes: &[u8; 4]| (far * near / (far - (far - near) * f64::from(f32::from_le_bytes(*bytes)))) as f32;
        let label = |bytes: &[u8; 4]| {
            let number = i32::from_le_bytes(*bytes);
            let body = if number < 0 { number } else { number & BODY_BITS };
            let known = place.bodies.iter().find(|(known, _)| *known == body);
            known.map(|(_, label)| *label).ok_or_else(|| {
                RecordingError::about(&labels, format_args!("the body {body}"), "one of the objects, or -1")
            })
        };
        let frame = |index: usize| {
            let pixels = index * pixels..(index + 1) * pixels;
            Ok(Frame {
                depths: depths[pixels.clone()].iter().map(depth).collect(),
                labels: bodies[pixels.clone()].iter().map(label).collect::<Result<_, RecordingError>>()?,
                colours: colours[pixels].iter().map(|[red, green, blue, _]| [*red, *green, *blue]).collect(),
            })
        };
        (0..self.poses.len()).map(frame).collect()
    }
}

/// The pixels of all frames, four bytes each.
fn pixels_of(path: &Path, count: usize) -> Result<Vec<[u8; 4]>, RecordingError> {
    let bytes = bytes_of(path)?;
    if bytes.len() == 4 * count {
        return Ok(bytes.as_chunks().0.to_vec());
    }
    Err(RecordingError::about(path, format_args!("{} bytes", bytes.len()), format_args!("{}", 4 * count)))
}

impl VisualShape {
    /// None for another type or no size; a mesh that is known is as good as a shape.
    fn shape(&self) -> Option<Shape> {
        let [x, y, z] = self.dims;
        let cuboid = || (x.min(y).min(z) > 0.0).then(|| Shape::Cuboid(0.5 * Vector3::from(self.dims)));
        match self.kind {
            2 => (x > 0.0).then_some(Shape::Sphere(x)),
            3 => cuboid(),
            4 => (x > 0.0 && y > 0.0).then_some(Shape::Cylinder { radius: y, half_height: 0.5 * x }),
            // A cube with edges of 1 m, times its dimensions.
            5 if self.file == "cube.obj" => cuboid(),
            _ => None,
        }
    }
}

impl Place {
    /// One more object, or its file where only that is known; none if it cannot be.
    fn add(&mut self, object: &Object, look: &VisualShape) -> Option<()> {
        let [roll, pitch, yaw] = object.rpy;
        let Some(shape) = look.shape() else {
            self.bodies.push((object.body_id, None));
            self.left_out.push(look.file.clone());
            return (look.kind == 5).then_some(());
        };
        let label = u16::try_from(self.world.solids.len()).ok()?.checked_add(FIRST_SOLID)?;
        let sizes = look.dims.iter().chain(&object.position);
        self.bodies.push((object.body_id, Some(label)));
        self.plain.push(look.kind != 5);
        self.world.solids.push(Solid {
            shape,
            pose: Pose {
                position: object.position.into(),
                world_from_body: EulerAngles { roll, pitch, yaw }.attitude(),
            },
            colour: [look.rgba[0], look.rgba[1], look.rgba[2]],
            ..Solid::block("object", Vector3::zeros(), Vector3::zeros())
        });
        sizes.into_iter().all(|size| size.abs() < REACH).then_some(())
    }

    fn count(&self, frame: &Frame, seen: &Image) -> Count {
        let mut count = Count::default();
        for (pixel, recorded) in frame.labels.iter().enumerate() {
            let Some(recorded) = recorded else { continue };
            let label = seen.labels[pixel];
            count.pixels += 1;
            count.labels += usize::from(!nearby(pixel, seen, |other| frame.labels[other] == Some(label)));
            if *recorded == label {
                let index = usize::from(label.wrapping_sub(FIRST_SOLID));
                let solid = self.world.solids.get(index);
                let is_round = solid.is_some_and(|solid| matches!(solid.shape, Shape::Sphere(_)));
                let (depth, expected) = (seen.depths[pixel], frame.depths[pixel]);
                count.depths +=
                    usize::from((depth - expected).abs() > DEPTH_SHARES[usize::from(is_round)] * expected);
                // Squares of the floor far away are smaller than pixels; what a mesh's texture is like, nobody says.
                let (ours, recorded) = (seen.colours[pixel], frame.colours[pixel]);
                let painted = solid.filter(|_| self.plain[index]);
                count.colours += usize::from(painted.is_some_and(|solid| !is_lit(ours, recorded, solid.colour)));
            }
        }
        count
    }
}

/// Whether any of the nine pixels around one is so.
fn nearby(pixel: usize, image: &Image, is_so: impl Fn(usize) -> bool) -> bool {
    let (columns, rows) = (image.columns, image.labels.len() / image.columns);
    let around = |at: usize, size: usize| at.saturating_sub(1)..=(at + 1).min(size - 1);
    let within = |row: usize| around(pixel % columns, columns).any(|column| is_so(row * columns + column));
    around(pixel / columns, rows).any(within)
}

/// Whether a recorded colour is ours, or would be in a shadow, which takes a fifth of all light that has a direction.
fn is_lit(ours: [u8; 3], recorded: [u8; 3], full: [f32; 3]) -> bool {
    (0..3).all(|i| {
        let (lit, ambient, recorded) = (f32::from(ours[i]), 0.6 * 255.0 * full[i], f32::from(recorded[i]));
        let shadowed = ambient + 0.8 * (lit - ambient);
        (recorded - lit).abs().min((recorded - shadowed).abs()) <= COLOUR_LEVELS
    })
}
