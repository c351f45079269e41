//! Reads back what a run wrote into `depth/`.

use crate::report::ReportError;
use exr::prelude::{FlatSamples, ReadChannels as _, ReadLayers as _};
use std::path::Path;

/// Depths along the optical axis in scene units, rows from the top, 0 where nothing is; `None` if there
/// is no such file.
///
/// # Errors
/// [`ReportError::Picture`] if the file is damaged or of another size.
pub(super) fn read_depth(
    path: &Path,
    (width, height): (u32, u32),
) -> Result<Option<Vec<f32>>, ReportError> {
    if !path.is_file() {
        return Ok(None);
    }
    let bad = |reason: String| ReportError::Picture {
        path: path.to_path_buf(),
        reason,
    };
    let picture = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_file(path)
        .map_err(|e| bad(e.to_string()))?;
    let layer = picture.layer_data;
    let size = (layer.size.width(), layer.size.height());
    if size != (width as usize, height as usize) {
        return Err(bad(format!(
            "it is {}x{} but the matte is {width}x{height}",
            size.0, size.1
        )));
    }
    layer
        .channel_data
        .list
        .into_iter()
        .find_map(|channel| match channel.sample_data {
            FlatSamples::F32(values) if channel.name.to_string() == "Z" => Some(values),
            _ => None,
        })
        .map(Some)
        .ok_or_else(|| bad("it has no 32-bit channel Z".to_owned()))
}
