//! A world to look at while drones fly in it: picture by picture, with the points that a mouse needs.

use kestrel_core::airframe::Airframe;
use kestrel_sim::camera::{Canvas, FIRST_SOLID, Image, Mover, Scene, View};
use kestrel_sim::world::{Pose, World};
use nalgebra::Vector3;

use crate::video::chase::{VIEW_ANGLE, behind, distance, free_share};
use crate::video::recorded_scene::with_goals;
use crate::video::{camera, shadow, trail};

/// Share of what the way to the camera has grown by that it goes back in a picture: it comes nearer at once.
const RETREAT_SHARE: f32 = 0.05;

/// From where a drone is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Direction in which the camera looks \[rad\], from the x axis towards the y axis.
    pub heading: f64,
    /// How far it is above the drone \[rad\].
    pub elevation: f64,
    /// Its distance, times that of the camera of videos.
    pub zoom: f64,
}

/// Drones in a world, and the last picture of them.
#[derive(Clone, Debug)]
pub struct LiveScene {
    world: World,
    airframe: Airframe,
    drones: usize,
    goals: Vec<Vector3<f64>>,
    /// With drones and goals.
    shown: Scene,
    /// Without them.
    still: Scene,
    /// Where the drones are \[m\].
    placed: Vec<Vector3<f64>>,
    share: f32,
    view: View,
    size: [usize; 2],
    canvas: Canvas,
    image: Image,
}

impl LiveScene {
    /// So many drones of an airframe in a world, not looked at yet.
    pub fn new(world: &World, airframe: &Airframe, drones: usize) -> Self {
        let still = Scene::new(world);
        Self {
            world: world.clone(),
            airframe: *airframe,
            drones,
            goals: Vec::new(),
            shown: still.clone().with_drones(airframe, drones),
            still,
            placed: Vec::new(),
            share: 1.0,
            view: View::towards(Vector3::zeros(), Vector3::x(), Vector3::z()),
            size: [0; 2],
            canvas: Canvas::default(),
            image: Image::default(),
        }
    }

    /// Shows balls on poles below these goals \[m, world\].
    pub fn show_goals(&mut self, goals: &[Vector3<f64>]) {
        if self.goals != goals {
            let world = with_goals(&self.world, goals.iter().copied());
            self.shown = Scene::new(&world).with_drones(&self.airframe, self.drones);
            self.goals = goals.to_vec();
        }
    }

    /// Puts drones and movable bodies where they are, in the order of the world.
    pub fn place(&mut self, drones: &[Pose], movables: &[Pose]) {
        self.placed = drones.iter().map(|pose| pose.position).collect();
        for (index, pose) in drones.iter().enumerate() {
            self.shown.place(Mover::Drone(index), pose);
        }
        for (index, pose) in movables.iter().enumerate() {
            self.shown.place(Mover::Movable(index), pose);
            self.still.place(Mover::Movable(index), pose);
        }
    }

    /// Takes a picture of so many columns and rows, around a point \[m, world\] and on its side of the walls; the image has
    /// `samples` × `samples` pixels for each of them.
    pub fn look(&mut self, focus: Vector3<f64>, orbit: &Orbit, size: [usize; 2], samples: usize) -> &Image {
        let Orbit { heading, elevation, zoom } = *orbit;
        let way = behind(heading, elevation) * zoom * distance(self.airframe.arm);
        let free = free_share(&self.still, focus, focus + way);
        self.share = free.min(self.share + RETREAT_SHARE * (free - self.share));
        self.view = View::towards(focus + way * f64::from(self.share), focus, Vector3::z());
        self.size = size;
        let camera = camera(size.map(|pixels| pixels * samples), VIEW_ANGLE);
        self.shown.render_into(&camera, &self.view, &mut self.canvas, &mut self.image);
        shadow::cast(&mut self.image, &camera, &self.view, self.placed.iter().copied(), self.airframe.arm);
        &self.image
    }

    /// Where a point of the world is in the last picture \[px\], unless it is behind something or outside.
    pub fn project(&self, point: Vector3<f64>) -> Option<[f64; 2]> {
        if self.image.depths.is_empty() {
            return None; // not looked at yet
        }
        trail::seen_at(point, &self.view, &self.image, self.size)
    }

    /// Where the ray through a pixel of the last picture meets a height \[m, world\], if it does in front of the camera.
    pub fn at_height(&self, pixel: [f64; 2], height: f64) -> Option<Vector3<f64>> {
        let ray = self.ray(pixel);
        let way = (height - self.view.eye.z) / ray.z;
        (way.is_finite() && way > 0.0).then(|| self.view.eye + ray * way)
    }

    /// Direction from the camera through a pixel of the last picture, not of length one.
    pub fn ray(&self, pixel: [f64; 2]) -> Vector3<f64> {
        let tangents = camera(self.size, VIEW_ANGLE).tangents;
        let [aside, below] =
            [0, 1].map(|axis| (2.0 * pixel[axis] / self.size[axis].max(1) as f64 - 1.0) * tangents[axis]);
        let View { right, down, forward, .. } = self.view;
        forward + right * aside + down * below
    }

    /// What a pixel of the last picture shows.
    pub fn pick(&self, [column, row]: [usize; 2]) -> Picked {
        let [columns, rows] = self.size;
        if column >= columns || row >= rows {
            return Picked::Nothing;
        }
        let samples = self.image.columns / columns;
        let pixel = samples * row * self.image.columns + samples * column;
        let label = self.image.labels.get(pixel).copied().unwrap_or_default();
        let Some(index) = label.checked_sub(FIRST_SOLID).map(usize::from) else { return Picked::Nothing };
        // Two marks a goal stand behind the solids of the world, then movables, then drones.
        let (solids, marks) = (self.world.solids.len(), 2 * self.goals.len());
        let first_drone = solids + marks + self.world.movables.len();
        if index < solids {
            Picked::Solid(index)
        } else if index < solids + marks {
            Picked::Goal((index - solids) / 2)
        } else if index < first_drone {
            Picked::Nothing
        } else {
            Picked::Drone(index - first_drone)
        }
    }
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Picked {
    /// The sky, the floor or a body that moves.
    Nothing,
    /// A solid of the world, by its index.
    Solid(usize),
    /// The mark of a goal, by its index.
    Goal(usize),
    /// A drone, by its index.
    Drone(usize),
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::CF2X;
    use kestrel_sim::world::Solid;

    use super::*;

    const ORBIT: Orbit = Orbit { heading: 0.0, elevation: 0.3, zoom: 1.0 };
    const SIZE: [usize; 2] = [160, 90];

    /// A drone at a metre's height, before a wall towards which the camera looks.
    fn scene(goal: Vector3<f64>) -> LiveScene {
        let mut world = World::empty();
        world.solids.push(Solid::block("wall", Vector3::new(2.0, -3.0, 0.0), Vector3::new(2.1, 3.0, 3.0)));
        let mut scene = LiveScene::new(&world, &CF2X, 1);
        scene.show_goals(&[goal]);
        scene.place(&[Pose::at(Vector3::z())], &[]);
        scene.look(Vector3::z(), &ORBIT, SIZE, 2);
        scene
    }

    #[test]
    fn a_point_is_seen_where_its_ray_goes() {
        let scene = scene(Vector3::new(1.0, 0.5, 1.0));
        let found = scene.project(Vector3::new(0.6, -0.2, 0.9)).unwrap();
        let back = scene.at_height(found, 0.9).unwrap();
        assert!((back - Vector3::new(0.6, -0.2, 0.9)).norm() < 1e-9, "{back}");
        assert_eq!(scene.project(Vector3::new(2.5, 0.0, 1.0)), None, "behind the wall");
        assert_eq!(scene.at_height([80.0, 89.0], 5.0), None, "above a camera that looks down");
    }

    #[test]
    fn what_is_under_the_mouse_has_a_name() {
        let goal = Vector3::new(1.0, 0.3, 1.0);
        let scene = scene(goal);
        let pixel = |point| scene.project(point).unwrap().map(|place: f64| place as usize);
        assert_eq!(scene.pick([80, 45]), Picked::Drone(0));
        assert_eq!(scene.pick(pixel(goal - 0.06 * Vector3::z())), Picked::Goal(0));
        assert_eq!(scene.pick(pixel(Vector3::new(2.0, -0.5, 1.0))), Picked::Solid(0));
        assert_eq!([scene.pick([0, 89]), scene.pick([160, 0]), scene.pick([0, 90])], [Picked::Nothing; 3]);
    }

    #[test]
    fn the_camera_stays_on_the_drone_s_side_of_a_wall() {
        let mut scene = scene(Vector3::zeros());
        let towards = Orbit { heading: std::f64::consts::PI, elevation: 0.0, zoom: 20.0 };
        scene.look(Vector3::z(), &towards, SIZE, 1);
        assert!(scene.view.eye.x > 0.3 && scene.view.eye.x < 2.0, "{}", scene.view.eye);
        let near = scene.view.eye.x;
        scene.look(Vector3::z(), &Orbit { heading: 0.0, ..towards }, SIZE, 1);
        assert!(-scene.view.eye.x < near + 1.0, "it goes back slowly: {}", scene.view.eye);
    }
}
