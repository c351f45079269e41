//! COLMAP's text model: `cameras.txt`, `images.txt`, `points3D.txt`.

use std::fmt::Write as _;

use crate::scene::DemoScene;

/// The three files' contents, in the order named above.
pub(crate) fn model(scene: &DemoScene) -> [String; 3] {
    [cameras(scene), images(scene), points(scene)]
}

// Writing to a String cannot fail, hence the discarded results below.

fn cameras(scene: &DemoScene) -> String {
    let mut text = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    if let Some(c) = scene.views.first().map(|view| &view.camera) {
        let _ = writeln!(
            text,
            "1 PINHOLE {} {} {} {} {} {}",
            c.width, c.height, c.fx, c.fy, c.cx, c.cy
        );
    }
    text
}

fn images(scene: &DemoScene) -> String {
    let mut text = String::from(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n",
    );
    for (index, view) in scene.views.iter().enumerate() {
        let (q, t) = (view.camera.rotation, view.camera.translation);
        let _ = writeln!(
            text,
            "{} {} {} {} {} {} {} {} 1 {}",
            index + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z,
            view.name
        );
        let seen = scene.points.iter().enumerate().flat_map(|(id, point)| {
            point
                .observations
                .iter()
                .filter(|o| o.view == index)
                .map(move |o| (id + 1, o.pixel))
        });
        let line: Vec<String> = seen
            .map(|(id, p)| format!("{:.4} {:.4} {id}", p.x, p.y))
            .collect();
        text.push_str(&line.join(" "));
        text.push('\n');
    }
    text
}

fn points(scene: &DemoScene) -> String {
    let mut text =
        String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
    // Position of the next observation in each view's line.
    let mut next = vec![0_usize; scene.views.len()];
    for (index, point) in scene.points.iter().enumerate() {
        let (p, [r, g, b]) = (point.position, point.color);
        let _ = write!(text, "{} {} {} {} {r} {g} {b} 0", index + 1, p.x, p.y, p.z);
        for observation in &point.observations {
            let _ = write!(text, " {} {}", observation.view + 1, next[observation.view]);
            next[observation.view] += 1;
        }
        text.push('\n');
    }
    text
}
