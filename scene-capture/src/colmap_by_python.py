"""Answers like the program colmap, as far as this crate asks it, by way of the module pycolmap."""
import sys

import pycolmap

OPTIONS = {
    "feature_extractor": [
        "database_path", "image_path", "image_list_path", "ImageReader.camera_model",
        "ImageReader.single_camera", "ImageReader.mask_path", "FeatureExtraction.use_gpu",
        "FeatureExtraction.max_image_size", "SiftExtraction.max_num_features",
    ],
    "exhaustive_matcher": ["database_path", "FeatureMatching.use_gpu", "ExhaustiveMatching.block_size"],
    "sequential_matcher": ["database_path", "FeatureMatching.use_gpu", "SequentialMatching.overlap"],
    "spatial_matcher": ["database_path", "FeatureMatching.use_gpu"],
    "mapper": [
        "database_path", "image_path", "output_path", "Mapper.ba_global_function_tolerance",
        "Mapper.init_min_num_inliers", "Mapper.init_min_tri_angle", "Mapper.abs_pose_min_num_inliers",
        "Mapper.abs_pose_min_inlier_ratio",
    ],
}


def main(command, *words):
    if command == "help":
        print(f"COLMAP {pycolmap.__version__} (pycolmap)")
        return 0
    if words == ("-h",):
        for name in OPTIONS.get(command, []):
            print(f"  --{name} arg")
        return 0
    given = {name.removeprefix("--"): value for name, value in zip(words[::2], words[1::2])}
    database = given["database_path"]
    if command == "feature_extractor":
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = given["ImageReader.camera_model"]
        if "ImageReader.mask_path" in given:
            reader.mask_path = given["ImageReader.mask_path"]
        options = pycolmap.FeatureExtractionOptions()
        options.max_image_size = int(given["FeatureExtraction.max_image_size"])
        options.sift.max_num_features = int(given["SiftExtraction.max_num_features"])
        with open(given["image_list_path"], encoding="utf-8") as names:
            names = names.read().splitlines()
        pycolmap.extract_features(
            database, given["image_path"], names, pycolmap.CameraMode.SINGLE,
            reader_options=reader, extraction_options=options, device=pycolmap.Device.cpu)
    elif command == "exhaustive_matcher":
        pairs = pycolmap.ExhaustivePairingOptions()
        pairs.block_size = int(given["ExhaustiveMatching.block_size"])
        pycolmap.match_exhaustive(database, pairing_options=pairs, device=pycolmap.Device.cpu)
    elif command == "sequential_matcher":
        pairs = pycolmap.SequentialPairingOptions()
        pairs.overlap = int(given["SequentialMatching.overlap"])
        pycolmap.match_sequential(database, pairing_options=pairs, device=pycolmap.Device.cpu)
    elif command == "spatial_matcher":
        pycolmap.match_spatial(database, device=pycolmap.Device.cpu)
    elif command == "mapper":
        options = pycolmap.IncrementalPipelineOptions()
        options.ba_global_function_tolerance = float(given["Mapper.ba_global_function_tolerance"])
        for name in ("init_min_num_inliers", "abs_pose_min_num_inliers"):
            if f"Mapper.{name}" in given:
                setattr(options.mapper, name, int(given[f"Mapper.{name}"]))
        for name in ("init_min_tri_angle", "abs_pose_min_inlier_ratio"):
            if f"Mapper.{name}" in given:
                setattr(options.mapper, name, float(given[f"Mapper.{name}"]))
        models = pycolmap.incremental_mapping(
            database, given["image_path"], given["output_path"], options)
        if not models:
            print("failed to create sparse model")
            return 1
    else:
        print(f"ERROR: no command {command}")
        return 1
    return 0


sys.exit(main(*sys.argv[1:]))
