//! Agisoft Metashape's `cameras.xml` (File > Export > Export Cameras).
//!
//! Poses take camera space (x right, y down, z forward) to a component's own frame, and a similarity
//! takes that to the world. The principal point is stated from the picture's middle; `P1, P2` are
//! OpenCV's `p2, p1`.

use crate::error::{ImportError, load_text};
use crate::format::Detected;
use crate::gather::{Found, Gather, Imported};
use crate::lens::Frame;
use crate::photos::ByName;
use crate::pose;
use glam::{DMat3, DVec2, DVec3};
use io_colmap::{Camera, Pose};
use roxmltree::{Document, Node};
use std::collections::HashMap;
use std::path::Path;

/// `p_world = scale * rotation * p + shift`
struct Similarity {
    rotation: DMat3,
    shift: DVec3,
    scale: f64,
}

pub(crate) fn read(detected: &Detected, images: Option<&Path>) -> Result<Imported, ImportError> {
    let path = &detected.source;
    let text = load_text(path)?;
    let document = Document::parse(&text).map_err(|e| {
        ImportError::line(
            path,
            e.pos().row as usize,
            format!("the XML is damaged ({e})"),
            "export the cameras again",
        )
    })?;
    let chunk = document
        .descendants()
        .find(|node| node.has_tag_name("chunk"))
        .ok_or_else(|| ImportError::bad(path, "it has no chunk", "export the cameras again"))?;
    let line = |node: Node| document.text_pos_at(node.range().start).row as usize;
    let fail = |node: Node, what: String| {
        ImportError::line(
            path,
            line(node),
            what,
            "correct it or export the cameras again",
        )
    };

    let photos = ByName::below(&detected.root, images)?;
    let mut gather = Gather::default();
    gather.leave_out(photos.left_out());
    let mut sensors: HashMap<&str, Result<Camera, String>> = HashMap::new();
    for sensor in descendants(chunk, "sensors", "sensor") {
        let camera = camera_of(sensor);
        sensors.insert(sensor.attribute("id").unwrap_or_default(), camera);
    }

    // Components are reconstructions that do not know of each other: the largest is taken.
    let aligned: Vec<Node> = descendants(chunk, "cameras", "camera")
        .filter(|camera| child(*camera, "transform").is_some())
        .collect();
    let mut sizes: HashMap<&str, usize> = HashMap::new();
    for camera in &aligned {
        *sizes
            .entry(camera.attribute("component_id").unwrap_or_default())
            .or_default() += 1;
    }
    let largest = sizes
        .iter()
        .max_by_key(|(id, size)| (**size, std::cmp::Reverse(**id)))
        .map(|(id, _)| *id)
        .unwrap_or_default();
    let placed = descendants(chunk, "components", "component")
        .find(|component| component.attribute("id") == Some(largest))
        .and_then(|component| child(component, "transform"))
        .or_else(|| child(chunk, "transform"));
    let world = match placed {
        Some(transform) => similarity(transform).map_err(|what| fail(transform, what))?,
        None => Similarity {
            rotation: DMat3::IDENTITY,
            shift: DVec3::ZERO,
            scale: 1.0,
        },
    };

    for camera in descendants(chunk, "cameras", "camera") {
        let label = camera.attribute("label").unwrap_or_default();
        let found = photos.find(label);
        let mut leave_out = |why| {
            gather.drop_view(label, why);
            gather.rivals.extend(found.clone());
        };
        let Some(transform) = child(camera, "transform") else {
            leave_out("was not aligned");
            continue;
        };
        if camera
            .attribute("enabled")
            .is_some_and(|word| ["false", "0"].contains(&word))
        {
            leave_out("is disabled");
            continue;
        }
        if camera.attribute("component_id").unwrap_or_default() != largest {
            leave_out("belongs to another component than most");
            continue;
        }
        let photo = match found {
            Ok(photo) => photo,
            Err(why) => {
                gather.drop_view(label, why);
                continue;
            }
        };
        let lens = match sensors.get(camera.attribute("sensor_id").unwrap_or_default()) {
            Some(Ok(lens)) => lens.clone(),
            Some(Err(what)) => {
                return Err(fail(camera, format!("the sensor of {label:?}: {what}")));
            }
            None => {
                return Err(fail(
                    camera,
                    format!("{label:?} has a sensor that is not listed"),
                ));
            }
        };
        let camera_from_world = pose_of(transform, &world)
            .map_err(|what| fail(camera, format!("the pose of {label:?}: {what}")))?;
        gather.views.push(Found {
            photo,
            mask: None,
            camera: lens,
            camera_from_world,
        });
    }
    gather.finish(detected.format, &detected.root, path)
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// Elements inside a list, also those in groups.
fn descendants<'a, 'i: 'a>(
    chunk: Node<'a, 'i>,
    list: &str,
    name: &'static str,
) -> impl Iterator<Item = Node<'a, 'i>> {
    child(chunk, list)
        .into_iter()
        .flat_map(|list| list.descendants())
        .filter(move |node| node.has_tag_name(name))
}

/// The numbers in an element.
fn numbers<const N: usize>(node: Node) -> Result<[f64; N], String> {
    let values: Option<Vec<f64>> = node
        .text()
        .unwrap_or_default()
        .split_whitespace()
        .map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()))
        .collect();
    values
        .and_then(|values| values.try_into().ok())
        .ok_or_else(|| format!("<{}> must be {N} finite numbers", node.tag_name().name()))
}

fn similarity(transform: Node) -> Result<Similarity, String> {
    let rotation = match child(transform, "rotation") {
        Some(node) => pose::rotation(rows9(numbers(node)?))?,
        None => DMat3::IDENTITY,
    };
    let shift = match child(transform, "translation") {
        Some(node) => DVec3::from_array(numbers(node)?),
        None => DVec3::ZERO,
    };
    let [scale] = match child(transform, "scale") {
        Some(node) => numbers(node)?,
        None => [1.0],
    };
    if scale <= 0.0 {
        return Err(format!("the scale is {scale}"));
    }
    Ok(Similarity {
        rotation,
        shift,
        scale,
    })
}

fn rows9(v: [f64; 9]) -> DMat3 {
    DMat3::from_cols_array(&v).transpose()
}

fn pose_of(transform: Node, world: &Similarity) -> Result<Pose, String> {
    let m: [f64; 16] = numbers(transform)?;
    let axes = pose::rows([[m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]]);
    let centre = DVec3::new(m[3], m[7], m[11]);
    pose::camera_from_world(
        world.rotation * axes,
        world.rotation * centre * world.scale + world.shift,
    )
}

fn camera_of(sensor: Node) -> Result<Camera, String> {
    // What the alignment found, if it was allowed to, else what was stated before.
    let calibrations: Vec<Node> = sensor
        .children()
        .filter(|node| node.has_tag_name("calibration"))
        .collect();
    let calibration = calibrations
        .iter()
        .find(|node| node.attribute("class") == Some("adjusted"))
        .or(calibrations.first())
        .ok_or("it has no calibration; align the photos before exporting")?;
    let resolution = child(*calibration, "resolution")
        .or_else(|| child(sensor, "resolution"))
        .ok_or("it has no resolution")?;
    let side = |name: &str| {
        resolution
            .attribute(name)
            .and_then(|word| word.parse::<u32>().ok())
            .filter(|side| (1..1 << 20).contains(side))
            .ok_or_else(|| format!("its {name} is not a number of pixels"))
    };
    let (width, height) = (side("width")?, side("height")?);
    let kind = calibration
        .attribute("type")
        .or_else(|| sensor.attribute("type"))
        .unwrap_or("frame");
    if kind == "spherical" {
        return Ok(Frame::panorama(width, height));
    }
    let value = |name: &str| match child(*calibration, name) {
        Some(node) => numbers::<1>(node).map(|[v]| v),
        None => Ok(0.0),
    };
    let (f, b1, b2) = (value("f")?, value("b1")?, value("b2")?);
    // Old versions write fx, fy and skew.
    let (fx, fy) = if f == 0.0 {
        (value("fx")?, value("fy")?)
    } else {
        (f + b1, f)
    };
    let middle = DVec2::new(f64::from(width), f64::from(height)) * 0.5;
    let offset = DVec2::new(value("cx")?, value("cy")?);
    let frame = Frame {
        width,
        height,
        focal: DVec2::new(fx, fy),
        // Old versions count from the corner.
        centre: if f == 0.0 { offset } else { middle + offset },
    };
    if let Some(lost) = frame.lost_with_skew(b2 + value("skew")?) {
        return Err(format!(
            "its skew b2 moves pixels by {lost:.1}, which no COLMAP camera does; optimise the cameras without b2"
        ));
    }
    if value("p3")? != 0.0 || value("p4")? != 0.0 {
        return Err(
            "it has p3 or p4, which no COLMAP camera has; optimise the cameras without".to_owned(),
        );
    }
    let k = [value("k1")?, value("k2")?, value("k3")?, value("k4")?];
    let p = [value("p2")?, value("p1")?];
    match kind {
        "frame" => frame.perspective(k, p),
        "fisheye" | "equidistant_fisheye" => frame.fisheye(k, p),
        other => Err(format!("cameras of type {other:?} are not known")),
    }
}
