use nalgebra::Vector3;
use pulp::Scalar;

use super::*;
use crate::camera::tests::{ahead, strewn_rings};
use crate::world::Floor;

/// The images of a scene with every instruction set that this machine has, the baseline first, then the dispatched one.
fn rendered(scene: &Scene, camera: &Camera, view: &View) -> Vec<Image> {
    let image = |run: &dyn Fn(Render<'_>)| {
        let (mut canvas, mut image) = (Canvas::default(), Image::default());
        image.fit(camera);
        run(Render { scene, camera, rays: Rays::new(camera, view), canvas: &mut canvas, image: &mut image });
        image
    };
    let mut images = vec![image(&|render| render.with_simd(Scalar)), scene.render(camera, view)];
    #[cfg(target_arch = "x86_64")]
    {
        images.extend(pulp::x86::V3::try_new().map(|simd| image(&|render| pulp::Simd::vectorize(simd, render))));
        images.extend(pulp::x86::V4::try_new().map(|simd| image(&|render| pulp::Simd::vectorize(simd, render))));
    }
    images
}

#[test]
fn every_instruction_set_draws_the_same_image() {
    let sizes = [(64, 48), (53, 31), (7, 3), (33, 50), (17, 9), (1, 1)];
    for (seed, (columns, rows)) in (0..).zip(sizes) {
        let camera = Camera { columns, rows, ..Camera::REFERENCE };
        for floor in [Floor::Solid, Floor::Absent] {
            let mut world = strewn_rings(seed, 12);
            world.floor = floor;
            let scene = Scene::new(&world);
            // From the middle of it, too, where the eye is inside of some and beside others.
            let within = View::towards(Vector3::new(2.5, 0.0, 0.9), Vector3::new(1.0, 0.4, 0.8), Vector3::z());
            for view in [ahead(), within] {
                let images = rendered(&scene, &camera, &view);
                for image in &images[1..] {
                    assert!(*image == images[0], "{columns} x {rows}, seed {seed}: images differ");
                }
            }
        }
    }
}
