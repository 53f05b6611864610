use std::fs;

use nalgebra::Vector3;
use tempfile::TempDir;

use crate::config::{AviaryConfig, AviaryParts, Document};
use crate::world::{Mesh, Shape, Solid};

const CUBE: &str = "mtllib cube.mtl
# a cube of two units, as four triangles and four squares
v -1 -1 -1
v 1 -1 -1 0.5 0.5 0.5
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
vt 0 0
vn 0 0 1
o cube
usemtl red
f 4/1/1 3/1/1 2/1/1
f 4//1 2//1 1//1
usemtl plain
f -4 -3 -2 -1
f 1 2 \\
  6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
";

const MATERIALS: &str = "newmtl red\nKd 0.9 0.1 0\nmap_Kd wood.png\nnewmtl plain\nKs 1 1 1\n";

/// A triangle as text.
const FACET: &str =
    "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n endloop\nendfacet\n";

fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

fn solids(world: &str, files: &[(&str, &[u8])]) -> Result<Vec<Solid>, String> {
    let folder = folder(files);
    let path = folder.path().join("world.yaml");
    fs::write(&path, world).unwrap();
    let place = AviaryParts::read(&path)
        .map_err(|error| error.to_string().replace(&format!("{}/", folder.path().display()), ""))?;
    Ok(place.world.solids)
}

/// The first line of the message about a mesh in a file.
fn refusal(name: &str, bytes: &[u8]) -> String {
    let world = format!("solids: [{{mesh: {{import: {name}}}}}]");
    solids(&world, &[(name, bytes)]).unwrap_err().lines().next().unwrap().to_owned()
}

/// A binary STL that says so many triangles, of these numbers.
fn binary(count: u32, triangles: &[[f32; 9]]) -> Vec<u8> {
    let mut bytes = [b"solid but binary".as_slice(), &[0; 64], &count.to_le_bytes()].concat();
    for triangle in triangles {
        bytes.extend([0; 12]);
        bytes.extend(triangle.iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn mesh(solid: &Solid) -> &Mesh {
    let Shape::Mesh(mesh) = &solid.shape else { panic!("{:?} is no mesh", solid.shape) };
    mesh
}

#[test]
fn an_obj_is_scaled_turned_moved_and_coloured() {
    let world = "solids: [{name: die, colour: [0, 0, 1], mesh: {import: cube.obj, scale: [1, 2, 3], at_m: [5, 0, 0], rpy_deg: [90, 0, 0]}}]";
    let files: [(&str, &[u8]); 2] = [("cube.obj", CUBE.as_bytes()), ("cube.mtl", MATERIALS.as_bytes())];
    let solid = solids(world, &files).unwrap().remove(0);
    let (low, high) = solid.extent();
    assert!((low - Vector3::new(4.0, -3.0, -2.0)).norm() < 1e-6, "{low}");
    assert!((high - Vector3::new(6.0, 3.0, 2.0)).norm() < 1e-6, "{high}");
    let mesh = mesh(&solid);
    assert_eq!(
        (solid.name.as_str(), mesh.corners.len(), mesh.triangles.len(), mesh.hull.len()),
        ("die", 8, 12, 8)
    );
    let red = |index: usize| mesh.triangles[index].colour == Some([0.9, 0.1, 0.0]);
    assert!((0..12).all(|index| red(index) == (index < 2)), "{:?}", mesh.triangles);
    for triangle in &mesh.triangles {
        let [a, b, c] = mesh.places(triangle);
        assert!((b - a).cross(&(c - a)).dot(&a) > 0.0, "all face outward");
    }
}

#[test]
fn each_part_is_a_body_and_a_part_of_furniture() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\no seat\nf 1 3 2\nf 1 2 4\ng back\nf 2 3 4\nf 1 4 3\no seat\nf 1 2 3\n";
    let world = "furniture: [{name: chair, scale: 2, parts: [{name: wood, mesh: {import: chair.obj}}]}]";
    let found = solids(world, &[("chair.obj", text.as_bytes())]).unwrap();
    let names: Vec<_> = found.iter().map(|solid| solid.name.as_str()).collect();
    assert_eq!(names, ["chair: wood: back", "chair: wood: seat"]);
    let triangles: Vec<_> = found.iter().map(|solid| mesh(solid).triangles.len()).collect();
    assert_eq!(triangles, [2, 3]);
    assert!((found[0].extent().1 - Vector3::repeat(2.0)).norm() < 1e-6);
}

#[test]
fn stl_is_the_same_as_text_and_binary() {
    let ascii = format!("solid corner\n{FACET}{}endsolid corner\n", FACET.replace("0 1 0", "0 0 1.5"));
    let numbers = [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.5]];
    let read = |bytes: &[u8]| solids("solids: [{mesh: {import: c.STL}}]", &[("c.STL", bytes)]).unwrap();
    let found = read(ascii.as_bytes());
    assert_eq!(found, read(&binary(2, &numbers)));
    assert_eq!((mesh(&found[0]).corners.len(), mesh(&found[0]).triangles.len()), (4, 2), "corners are shared");
}

#[test]
fn a_surface_in_one_plane_has_a_skin_to_the_touch() {
    let text = format!("solid\n{FACET}endsolid\n");
    let found = solids("solids: [{mesh: {import: flat.stl}}]", &[("flat.stl", text.as_bytes())]).unwrap();
    let (low, high) = found[0].extent();
    assert!((low.z + 1e-3).abs() < 1e-6 && (high.z - 1e-3).abs() < 1e-6, "{low} {high}");
}

#[test]
fn a_resolved_world_needs_no_other_file() {
    let files: [(&str, &[u8]); 2] = [("cube.obj", CUBE.as_bytes()), ("cube.mtl", MATERIALS.as_bytes())];
    let folder = folder(&files);
    let path = folder.path().join("world.yaml");
    fs::write(&path, "solids: [{mesh: {import: cube.obj, materials: {plain: [1, 1, 0]}}}]").unwrap();
    let document = Document::read(&path).unwrap();
    let resolved = serde_yaml::to_string(&document.decode::<AviaryConfig>().unwrap()).unwrap();
    let again = Document::parse("elsewhere.yaml", &resolved).unwrap();
    let again = again.decode::<AviaryConfig>().unwrap().place(&again.root()).unwrap();
    assert_eq!(again, AviaryParts::read(&path).unwrap());
    assert!(resolved.contains("red") && !resolved.contains("import"), "{resolved}");
}

#[test]
fn a_file_without_a_mesh_gets_its_message() {
    let missing = solids("solids: [{mesh: {import: none.obj}}]", &[]).unwrap_err();
    assert_eq!(
        missing.lines().next().unwrap(),
        "world.yaml:1:26: solids.0.mesh.import: found no such file (none.obj), expected a mesh: a file `.obj` or `.stl`, \
        relative to the file that imports it"
    );
    assert_eq!(
        refusal("chair.ply", b"ply"),
        "world.yaml:1:26: solids.0.mesh.import: found a file of another kind (chair.ply), expected a mesh: a file `.obj` \
        or `.stl`, relative to the file that imports it"
    );
    let elsewhere = solids("room: {import: cube.obj}", &[("cube.obj", CUBE.as_bytes())]).unwrap_err();
    assert!(elsewhere.contains("room.import: found a mesh (cube.obj), expected meshes only in a key `mesh`"));
    let long = vec![b'\n'; (16 << 20) + 1];
    assert!(refusal("long.obj", &long).contains("found more than 16 MiB (long.obj), expected a mesh"));
    assert!(refusal("big.stl", &long).contains("found more than 16 MiB (big.stl), expected a mesh"));
}

#[test]
fn a_wrong_obj_is_refused_at_its_line() {
    for (text, expected) in [
        ("", "1:1: found no faces, expected at least one `f` with three corners"),
        ("v 0 0 0\nv 1 0 0\n", "2:1: found no faces, expected at least one `f` with three corners"),
        ("v 0 0\n", "1:1: found 2 numbers behind `v`, expected three"),
        ("v 0 0 0\nv 1 nan 0\n", "2:5: found `nan`, expected a finite number"),
        ("v 0 0 x\n", "1:7: found `x`, expected a finite number"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "4:7: found `4`, expected one of the 3 corners (`v`) above"),
        ("v 0 0 0\nv 1 0 0\nf 1 2 -3\n", "3:7: found `-3`, expected one of the 2 corners (`v`) above"),
        ("v 0 0 0\nf 0 1 1\n", "2:3: found `0`, expected a corner of a face, such as `7`, `7/1` or `7/1/3`"),
        ("v 0 0 0\nf 1 1\n", "2:1: found a face of 2 corners, expected three or more"),
        (
            "v 0 0 0\nvp 1 2\n",
            "2:1: found `vp`, expected `v`, `vt`, `vn`, `f`, `o`, `g`, `s`, `usemtl` or `mtllib`",
        ),
        (
            "v 0 0 0\nv 2 0 0\nv 0.1 0.1 0\nv 0 2 0\nf 1 2 3 4\n",
            "5:1: found a face that is not convex, expected triangles and convex polygons (triangulate when exporting)",
        ),
        (
            "mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
            "1:8: found no such file (none.mtl), expected the file of its materials beside it",
        ),
    ] {
        assert_eq!(refusal("bad.obj", text.as_bytes()), format!("bad.obj:{expected}"));
    }
    assert_eq!(
        refusal("bad.obj", b"v 0 0 0\nv \xff 0 0\n"),
        "bad.obj:2:3: found the byte 0xff, expected text in UTF-8"
    );
    let fan: String = ["v 0 0 0\n".repeat(3), "f 1 2 3\n".repeat(65_537)].concat();
    assert!(
        refusal("bad.obj", fan.as_bytes())
            .ends_with("found triangle number 65537, expected at most 65536 in a mesh")
    );
    let shown =
        solids("solids: [{mesh: {import: bad.obj}}]", &[("bad.obj", b"v 0 0 0\nv 1 nan 0\n")]).unwrap_err();
    assert!(shown.contains("2 | v 1 nan 0\n    |     ^\n  imported by world.yaml:1:26"), "{shown}");
}

#[test]
fn a_wrong_library_is_refused_at_its_line() {
    let refused = |library: &str| {
        let files: [(&str, &[u8]); 2] = [("cube.obj", CUBE.as_bytes()), ("cube.mtl", library.as_bytes())];
        solids("solids: [{mesh: {import: cube.obj}}]", &files).unwrap_err().lines().next().unwrap().to_owned()
    };
    assert_eq!(refused("newmtl red\nKd 1 2 0\n"), "cube.mtl:2:6: found `2`, expected a number from 0 to 1");
    assert_eq!(refused("newmtl red\nKd 1\n"), "cube.mtl:2:1: found 1 numbers behind `Kd`, expected three");
    assert_eq!(refused("Kd 1 0 0\n"), "cube.mtl:1:1: found `Kd` of no material, expected `newmtl` before it");
}

#[test]
fn a_wrong_stl_is_refused_at_its_line_or_byte() {
    for (text, expected) in [
        ("solid\nendsolid\n", "2:1: found no faces, expected at least one `facet`"),
        ("solid\nfacet normal 0 0 1\nvertex 0 0 inf\n", "3:12: found `inf`, expected a finite number"),
        ("solid\nfacet normal 0 0 1\nvertex 0 0 0\nendfacet\n", "4:1: found a facet of 1 corners, expected three"),
        (
            "solid\nfacet normal 0 0 1\nvertex 0 0 0\n",
            "2:1: found a facet without its end, expected `endfacet` after three `vertex`",
        ),
        (
            "solid\nfacets\n",
            "2:1: found `facets`, expected `solid`, `facet`, `outer loop`, `vertex`, `endloop`, `endfacet` or `endsolid`",
        ),
    ] {
        assert_eq!(refusal("bad.stl", text.as_bytes()), format!("bad.stl:{expected}"));
    }
    let cut = format!("solid\n{FACET}");
    assert_eq!(
        refusal("bad.stl", cut.as_bytes()),
        "bad.stl:8:1: found the end of the file, expected `endsolid` before it"
    );
    let at = "world.yaml:1:26: solids.0.mesh.import: found";
    let whole = binary(2, &[[0.5; 9]; 2]);
    assert_eq!(
        refusal("bad.stl", &whole[..whole.len() - 30]),
        format!("{at} 154 bytes (bad.stl), expected 184, the length of an STL of the 2 triangles that it says")
    );
    assert_eq!(
        refusal("bad.stl", b"short"),
        format!("{at} 5 bytes (bad.stl), expected an STL, which has at least 84 bytes")
    );
    assert_eq!(refusal("bad.stl", &binary(0, &[])), format!("{at} 0 triangles (bad.stl), expected 1 to 65536"));
    let mut numbers = [0.5; 9];
    numbers[4] = f32::NAN;
    assert_eq!(
        refusal("bad.stl", &binary(1, &[numbers])),
        format!("{at} NaN in a corner of triangle 1 at byte 108 (bad.stl), expected finite numbers")
    );
}

#[test]
fn a_mesh_too_large_or_without_extent_is_refused() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let refused = |keys: &str, text: &str| {
        let world = format!("solids: [{{name: x, mesh: {{import: t.obj, {keys}}}}}]");
        let message = solids(&world, &[("t.obj", text.as_bytes())]).unwrap_err();
        message.lines().next().unwrap().split_once(": ").unwrap().1.to_owned()
    };
    assert_eq!(
        refused("scale: [2000, 1, 1]", triangle),
        "solids.0.mesh.obj: found a corner at 2000 m (x), expected corners at most 1000 m from its origin along each axis (`scale`)"
    );
    assert_eq!(
        refused("", &triangle.replace("0 1 0", "2 0 0")),
        "solids.0.mesh.obj: found corners on one line (x), expected a surface that is at least two micrometres wide"
    );
    assert_eq!(
        refused("scale: [0, 1, 1]", triangle),
        "solids.0.mesh.scale.0: found 0, expected a number above 0, at most 1000000"
    );
    let inline = "solids: [{mesh: {obj: \"v 0 0 0\\nv 0 0\"}}]";
    let message = solids(inline, &[]).unwrap_err();
    assert!(
        message.contains("solids.0.mesh.obj: found 2 numbers behind `v` in line 2, expected three"),
        "{message}"
    );
}
