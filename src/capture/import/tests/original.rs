//! A capture written as other programs do, by their documented conventions.

use crate::capture::describe;
use crate::capture::import::transposed;
use crate::input::FileAccess;
use crate::views::Camera;
use glam::{DMat3, DQuat, DVec3};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// A capture's cameras, all of one lens.
pub(super) struct Original {
    pub(super) names: Vec<String>,
    pub(super) cameras: Vec<Camera>,
    /// `k1 k2 p1 p2` in OpenCV's order.
    pub(super) lens: [f64; 4],
}

impl Original {
    /// The bundled capture without polarisers, as a pinhole or through a lens.
    pub(super) fn new(lens: [f64; 4], stretch: f64, shift: [f64; 2]) -> Self {
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/unpolarised");
        let description = describe(&bundled, &FileAccess::default()).unwrap();
        let names = description.frames.iter().map(|frame| frame.view.name.clone()).collect();
        let mut cameras: Vec<Camera> = description.frames.iter().map(|frame| frame.view.camera).collect();
        for camera in &mut cameras {
            camera.focal[1] *= stretch;
            (0..2).for_each(|k| camera.principal[k] += shift[k]);
        }
        Original { names, cameras, lens }
    }

    /// A folder of the capture's photographs and mesh, which all formats name alike.
    pub(super) fn folder(&self) -> (tempfile::TempDir, PathBuf) {
        let outer = tempfile::tempdir().unwrap();
        let folder = outer.path().join("capture");
        fs::create_dir(&folder).unwrap();
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/unpolarised");
        for name in self.names.iter().map(String::as_str).chain(["scan.ply"]) {
            fs::copy(bundled.join(name), folder.join(name)).unwrap();
        }
        (outer, folder)
    }

    pub(super) fn write(&self, format: &str, folder: &Path) -> PathBuf {
        let put = |name: &str, text: String| {
            fs::write(folder.join(name), text).unwrap();
            folder.join(name)
        };
        match format {
            "colmap" => {
                put("cameras.txt", self.colmap_cameras());
                put("images.txt", self.colmap_images());
                folder.to_owned()
            }
            "metashape" => put("cameras.xml", self.metashape()),
            "xmp" => {
                for (name, camera) in self.names.iter().zip(&self.cameras) {
                    put(&name.replace(".png", ".xmp"), self.sidecar(camera));
                }
                folder.to_owned()
            }
            "csv" => put("cameras.csv", self.table()),
            "meshroom" => put("cameras.sfm", self.meshroom(true)),
            "old meshroom" => put("sfm.json", self.meshroom(false)),
            "openmvg" => put("sfm_data.json", self.openmvg()),
            other => panic!("{other}"),
        }
    }

    fn colmap_cameras(&self) -> String {
        let Camera { width, height, focal: [f, g], principal: [x, y], .. } = self.cameras[0];
        let [k1, k2, p1, p2] = self.lens;
        format!("1 OPENCV {width} {height} {f} {g} {x} {y} {k1} {k2} {p1} {p2}\n")
    }

    fn colmap_images(&self) -> String {
        let mut text = String::new();
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let q = DQuat::from_mat3(&matrix(camera).transpose());
            let [x, y, z] = camera.translation;
            let _ = writeln!(text, "{index} {} {} {} {} {x} {y} {z} 1 {name}\n", q.w, q.x, q.y, q.z);
        }
        text
    }

    /// In a chunk of its own turn, place and unit, with a camera that is disabled and one that is not aligned.
    fn metashape(&self) -> String {
        let (turn, place, scale) = (DMat3::from_rotation_y(0.7), DVec3::new(3.0, -2.0, 5.0), 12.5);
        let Camera { width, height, focal, principal, .. } = self.cameras[0];
        let [k1, k2, p1, p2] = self.lens;
        let (w, h) = (f64::from(width), f64::from(height));
        let mut cameras = String::new();
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let centre = turn.transpose() * (DVec3::from_array(camera.centre()) - place) / scale;
            let axes = turn.transpose() * matrix(camera);
            let [x, y, z] = axes.transpose().to_cols_array_2d();
            let row = |r: [f64; 3], c: f64| format!("{} {} {} {c}", r[0], r[1], r[2]);
            let stem = name.trim_end_matches(".png");
            let _ = writeln!(
                cameras,
                "<camera id=\"{index}\" sensor_id=\"7\" component_id=\"0\" label=\"{stem}\"><transform>{} {} {} 0 0 0 1</transform></camera>",
                row(x, centre.x),
                row(y, centre.y),
                row(z, centre.z)
            );
        }
        let rows = turn.transpose().to_cols_array().map(|v| v.to_string()).join(" ");
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\"><chunk label=\"Chunk 1\" enabled=\"true\">
            <sensors next_id=\"8\"><sensor id=\"7\" label=\"unknown\" type=\"frame\"><resolution width=\"{width}\" height=\"{height}\"/>
            <calibration type=\"frame\" class=\"initial\"><f>1</f></calibration>
            <calibration type=\"frame\" class=\"adjusted\"><resolution width=\"{width}\" height=\"{height}\"/>
            <f>{}</f><cx>{}</cx><cy>{}</cy><b1>{}</b1><k1>{k1}</k1><k2>{k2}</k2><p1>{p2}</p1><p2>{p1}</p2></calibration></sensor></sensors>
            <components active_id=\"0\"><component id=\"0\"><transform><rotation locked=\"true\">{rows}</rotation>
            <translation>{} {} {}</translation><scale>{scale}</scale></transform></component></components>
            <cameras><group id=\"0\">{cameras}</group><camera id=\"90\" sensor_id=\"7\" label=\"off\" enabled=\"false\"/>
            <camera id=\"91\" sensor_id=\"7\" label=\"lost\"/></cameras></chunk></document>",
            focal[1],
            principal[0] - 0.5 * w,
            principal[1] - 0.5 * h,
            focal[0] - focal[1],
            place.x,
            place.y,
            place.z
        )
    }

    fn sidecar(&self, camera: &Camera) -> String {
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let longer = w.max(h);
        let [k1, k2, p1, p2] = self.lens;
        let join = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        format!(
            "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">
            <rdf:Description xcr:Version=\"3\" xcr:PosePrior=\"locked\" xcr:Coordinates=\"absolute\" xcr:DistortionModel=\"brown3t2\"
            xcr:FocalLength35mm=\"{}\" xcr:Skew=\"0\" xcr:AspectRatio=\"{}\" xcr:PrincipalPointU=\"{}\" xcr:PrincipalPointV=\"{}\"
            xmlns:xcr=\"http://www.capturingreality.com/ns/xcr/1.1#\"><xcr:Rotation>{}</xcr:Rotation><xcr:Position>{}</xcr:Position>
            <xcr:DistortionCoeficients>{k1} {k2} 0 0 {p2} {p1}</xcr:DistortionCoeficients></rdf:Description></rdf:RDF></x:xmpmeta>",
            36.0 * camera.focal[0] / longer,
            camera.focal[1] / camera.focal[0],
            (camera.principal[0] - 0.5 * w) / longer,
            (camera.principal[1] - 0.5 * h) / longer,
            join(camera.rotation.as_flattened()),
            join(&camera.centre())
        )
    }

    fn table(&self) -> String {
        let mut text = "#cameras 10\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n".to_owned();
        let [k1, k2, p1, p2] = self.lens;
        for (name, camera) in self.names.iter().zip(&self.cameras) {
            let (w, h) = (f64::from(camera.width), f64::from(camera.height));
            let longer = w.max(h);
            let [x, y, z] = camera.centre();
            // Columns: right, up and back; as a turn by -heading around z, pitch around x, roll around y.
            let [right, down, ahead] = camera.rotation;
            let (up, back) = (down.map(|v| -v), ahead.map(|v| -v));
            let heading = -(-up[0]).atan2(up[1]).to_degrees();
            let (pitch, roll) = (up[2].asin().to_degrees(), (-right[2]).atan2(back[2]).to_degrees());
            let _ = writeln!(
                text,
                "{name},{x},{y},{z},{heading},{pitch},{roll},{},{},{},{k1},{k2},0,0,{p2},{p1}",
                36.0 * camera.focal[0] / longer,
                (camera.principal[0] - 0.5 * w) / longer,
                (camera.principal[1] - 0.5 * h) / longer
            );
        }
        text
    }

    fn meshroom(&self, new: bool) -> String {
        let Camera { width, height, focal: [f, g], principal: [x, y], .. } = self.cameras[0];
        let (w, h) = (f64::from(width), f64::from(height));
        let [k1, k2, p1, p2] = self.lens;
        let quoted = |numbers: &[f64]| numbers.iter().map(|v| format!("\"{v}\"")).collect::<Vec<_>>().join(", ");
        let lens = quoted(&[k1, k2, 0.0, p1, p2]);
        let intrinsic = if new {
            format!(
                "\"sensorWidth\": \"23.5\", \"sensorHeight\": \"15.6\", \"type\": \"pinhole\", \"distortionType\": \"brown\", \"undistortionType\": \"none\",
                \"focalLength\": \"{}\", \"initialFocalLength\": \"-1\", \"pixelRatio\": \"{}\", \"principalPoint\": [{}], \"locked\": \"false\"",
                g * 23.5 / w,
                g / f,
                quoted(&[x - 0.5 * w, y - 0.5 * h])
            )
        } else {
            format!(
                "\"type\": \"brown\", \"pxFocalLength\": \"{f}\", \"principalPoint\": [{}], \"locked\": \"1\"",
                quoted(&[x, y])
            )
        };
        let (mut views, mut poses) = (String::new(), String::new());
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let id = 9_000_000 + index;
            let comma = if index == 0 { "" } else { "," };
            let _ = write!(
                views,
                "{comma}{{\"viewId\": \"{id}\", \"poseId\": \"{id}\", \"intrinsicId\": \"5\", \"path\": \"D:\\\\elsewhere\\\\photos\\\\{name}\"}}"
            );
            // Columns of world to camera.
            let columns = transposed(camera.rotation);
            let _ = write!(
                poses,
                "{comma}{{\"poseId\": \"{id}\", \"pose\": {{\"transform\": {{\"rotation\": [{}], \"center\": [{}]}}, \"locked\": \"0\"}}}}",
                quoted(columns.as_flattened()),
                quoted(&camera.centre())
            );
        }
        let version = if new { "[\"1\", \"2\", \"11\"]" } else { "[\"1\", \"0\", \"0\"]" };
        format!(
            "{{\"version\": {version}, \"featuresFolders\": [], \"views\": [{views}, {{\"viewId\": \"1\", \"path\": \"/x/lost.png\"}}],
            \"intrinsics\": [{{\"intrinsicId\": \"5\", \"width\": \"{width}\", \"height\": \"{height}\", {intrinsic}, \"distortionParams\": [{lens}]}}],
            \"poses\": [{poses}]}}"
        )
    }

    /// Each photograph with intrinsics of its own, of which only the first have their type's name.
    fn openmvg(&self) -> String {
        let [k1, k2, p1, p2] = self.lens;
        let (mut views, mut intrinsics, mut extrinsics) = (String::new(), String::new(), String::new());
        for (index, (name, camera)) in self.names.iter().zip(&self.cameras).enumerate() {
            let Camera { width, height, focal: [f, _], principal: [x, y], rotation, .. } = camera;
            let comma = if index == 0 { "" } else { "," };
            let kind = match index {
                0 => "\"polymorphic_id\": 2147483649, \"polymorphic_name\": \"pinhole_brown_t2\"".to_owned(),
                _ => "\"polymorphic_id\": 1".to_owned(),
            };
            let _ = write!(
                views,
                "{comma}{{\"key\": {index}, \"value\": {{\"polymorphic_id\": 1073741824, \"ptr_wrapper\": {{\"id\": {}, \"data\": {{\"local_path\": \"\",
                \"filename\": \"{name}\", \"width\": {width}, \"height\": {height}, \"id_view\": {index}, \"id_intrinsic\": {index}, \"id_pose\": {index}}}}}}}}}",
                2_147_483_649u64 + index as u64
            );
            let _ = write!(
                intrinsics,
                "{comma}{{\"key\": {index}, \"value\": {{{kind}, \"ptr_wrapper\": {{\"id\": 9, \"data\": {{\"width\": {width}, \"height\": {height},
                \"focal_length\": {f}, \"principal_point\": [{x}, {y}], \"disto_t2\": [{k1}, {k2}, 0.0, {p1}, {p2}]}}}}}}}}"
            );
            let _ = write!(
                extrinsics,
                "{comma}{{\"key\": {index}, \"value\": {{\"rotation\": {rotation:?}, \"center\": {:?}}}}}",
                camera.centre()
            );
        }
        format!(
            "{{\"sfm_data_version\": \"0.3\", \"root_path\": \"/elsewhere\", \"views\": [{views}], \"intrinsics\": [{intrinsics}],
            \"extrinsics\": [{extrinsics}], \"structure\": [], \"control_points\": []}}"
        )
    }
}

/// Camera to world: columns are the camera's axes.
fn matrix(camera: &Camera) -> DMat3 {
    DMat3::from_cols_array_2d(&camera.rotation)
}
