//! Texts: captures, calibrations, rigs, jobs, published fits, directions.

use crate::{Seeds, pictures::SIDE};

const POSES: [&str; 3] = [
    "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]",
    "[[0.6,0,0.8,3.2],[0,1,0,0],[-0.8,0,0.6,2.4],[0,0,0,1]]",
    "[[0,0,1,4],[0,1,0,0],[-1,0,0,0]]",
];

/// Puts texts.
pub fn put(seeds: &Seeds) {
    captures(seeds);
    colmap(seeds);
    imports(seeds);
    calibrations(seeds);
    let job = r#"{"mesh":"a.obj","material":MATERIAL,"environment":{"file":"e.exr","scale":2,"rotation_y_deg":30},
"camera":{"position":[0,0,5],"target":[0,0,0],"up":[0,1,0],"fov_y_deg":90},"size":[200,100],"shadows":false,"evaluator":"published"}"#;
    let materials = [
        r#"{"model":"cook-torrance","diffuse":0.2,"specular":[1,0.5,0.2],"roughness":0.3,"reflectance":0.04}"#,
        r#"{"model":"cook-torrance","distribution":"ggx","roughness":{"texture":"r.png","scale":0.5}}"#,
        r#"{"model":"ward","roughness":[0.1,0.3],"diffuse":{"texture":"d.png"}}"#,
        r#"{"model":"ashikhmin-shirley","exponent":[100,20],"reflectance":0.1}"#,
        r#"{"model":"lafortune","coefficients":[-1,0.9],"exponent":20}"#,
        r#"{"model":"torrance-sparrow","roughness":0.2}"#,
        r#"{"model":"blinn-phong","exponent":30}"#,
        r#"{"model":"blinn-phong","exponent":{"texture":"e.png","scale":100}}"#,
        r#"{"model":"lambert","diffuse":0.5,"shine":[1,{"a":2}]}"#,
        r#"{"model":"dsbrdf","file":"m.tsuya","name":"lobes"}"#,
    ];
    for (number, material) in materials.iter().enumerate() {
        seeds.put("job", &format!("job-{number}"), job.replace("MATERIAL", material));
    }
    let asset = r#"{"asset":"a.tsuya","environment":{"file":"e.hdr"},"camera":{"position":[1,2,3],"target":[0,0,0],"up":[0,0,1],
"fov_y_deg":45.5},"size":[1,1],"evaluator":"reference","samples":4}"#;
    seeds.put("job", "asset", asset);
    let lambert = "Aggregate(Lambertian(albedo = [0.1, 0.2, 0.3]), ";
    let fits = [
        "NganBlinnPhong(albedo = [0.1, 0.1, 0.1], sharpness = 20.5))",
        "NganWard(albedo = [0.1, 0.1, 0.1], roughness = 0.2))",
        "NganCookTorrance(albedo = [0.1, 0.1, 0.1], roughness = 0.2, eta = 0.05))",
        "NganAshikhminShirley(albedo = [0.1, 0.1, 0.1], sharpness = 100, fresnelReflectance = 0.1))",
        "NganLafortune(albedo = [0.1, 0.1, 0.1], Cxy = -0.9, Cz = 0.8, sharpness = 10))",
        "Bagher(albedo = [1, 1, 1], alpha = [0.1, 0.1, 0.1], p = [1, 1, 1], eta = [[0, 0, 0], [1, 1, 1]], K = [1, 1, 1], \
         Lambda = [1, 1, 1], c = [0.1, 0.1, 0.1], k = [0.5, 0.5, 0.5], theta0 = [0.1, 0.1, 0.1]))",
    ];
    for (number, fit) in fits.iter().enumerate() {
        seeds.put("job", &format!("fit-{number}"), format!("# fits\nmaterial-{number} = {lambert}{fit}\n"));
    }
    seeds.put(
        "directions",
        "rows",
        "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z\n# rows\n0.6,0,0.8,0,0,1\n\n-1e3, 2 ,3,1e-11,0,5.5\n",
    );
    seeds.put("directions", "faults", "0,0,0,0,0,1\n1,2,3\nnan,inf,-0,1e400,+1,.5");
    for (name, text) in [
        (
            "angles",
            "theta_i,phi_i,theta_o,phi_o,r,g,b,lot\n10,0,20,90,0.1,0.2,0.3,a\n# none\n10,0,20,90,0.11,,1e-1,b\n95,0,1,0,-1,2,3\n",
        ),
        (
            "commas",
            "sep=;\n\"theta_i (deg)\";phi_i [rad];theta_r;phi_r;value;sigma (%);noise\r\n10,5;0;20;90;0,125;2;0,001\r\n",
        ),
        ("spectrum", "% wi_x wi_y wi_z wo_x wo_y wo_z 450 nm550 650nm\n0 0 1 0.6 0 0.8 0.1 0.2 0.3\n1\t2"),
        ("half", "theta_h\ttheta_d\tphi_d\tbrdf\trank\n5\t40\t90\t0.3\t1\n5\t40\t90\tn/a\t2"),
        (
            "json",
            r#"[{"theta_i":1,"phi_i":2,"theta_o":3,"phi_o":4,"value":0.5},{"theta_i":1,"phi_i":2,"theta_o":3,"phi_o":4,"value":null}]"#,
        ),
        (
            "samples",
            r#"{"samples":[{"wi_x":0,"wi_y":0,"wi_z":1,"wo_x":0,"wo_y":0,"wo_z":"2","r":1,"g":2,"b":3,"noise":0.1}]}"#,
        ),
        ("doubt", "theta_i;phi_i;theta_o;phi_o;value\n1;2;3;4;1,234\n1;2;3;4;1.5"),
    ] {
        seeds.put("directions", name, text);
    }
}

fn captures(seeds: &Seeds) {
    let frame = |k: usize, more: &str| {
        let name = ["a.tif", "b.tif", "./a.tif"][k];
        format!("{{\"file_path\":\"{name}\",\"transform_matrix\":{}{more}}}", POSES[k])
    };
    let head =
        format!("\"w\":{SIDE},\"h\":{SIDE},\"fl_x\":8.5,\"fl_y\":8,\"cx\":4,\"cy\":4.25,\"mesh_file\":\"m.ply\"");
    let plain = format!("{{{head},\"frames\":[{},{},{}]}}", frame(0, ""), frame(1, ""), frame(2, ""));
    seeds.put("transforms", "plain", plain);
    let light = "\"light\":{\"type\":\"point\",\"intensity\":[30,20,10],\"position\":[1,2,3]}";
    let own = frame(0, ",\"light_position\":[3,2,1],\"light_intensity\":5,\"mask_path\":\"mask.tif\"");
    let lit = format!("{{{head},{light},\"color_space\":\"linear-rec2020\",\"frames\":[{own},{}]}}", frame(1, ""));
    seeds.put("transforms", "lit", lit);
    let board = "\"white_reference\":{\"file_path\":\"b.tif\",\"cross_file_path\":\"a.tif\"}";
    let cross = ",\"cross_file_path\":\"b.tif\"";
    let polarised = format!(
        "{{{head},{board},\"color_space\":\"gamma-2.2\",\"frames\":[{},{}]}}",
        frame(0, cross),
        frame(1, cross)
    );
    seeds.put("transforms", "polarised", polarised);
    let shot = |file: &str, key: &str, value: f64| format!("{{\"file_path\":\"{file}\",\"{key}\":{value}}}");
    let posed = |k: usize, keys: &str| format!("{{{keys},\"transform_matrix\":{}}}", POSES[k]);
    let list = |key: &str, values: [f64; 3]| {
        let [a, b, c] = values;
        format!("{},{},{}", shot("a.tif", key, a), shot("b.tif", key, b), shot("a.tif", key, c))
    };
    let rotating = posed(0, &format!("\"polarisers\":[{}]", list("angle", [0.0, 45.0, 100.0])));
    seeds.put("transforms", "rotating", format!("{{{head},\"frames\":[{rotating}]}}"));
    let parallel = posed(1, "\"parallel_file_path\":\"a.tif\",\"cross_file_path\":\"b.tif\"");
    let board = "\"white_reference\":{\"parallel_file_path\":\"b.tif\",\"cross_file_path\":\"a.tif\"}";
    seeds.put("transforms", "parallel", format!("{{{head},{board},\"frames\":[{parallel}]}}"));
    for (name, mosaic) in [("mosaic", "true"), ("coloured", "{\"angles\":[90,45,135,0],\"colours\":\"RGGB\"}")] {
        let text = format!("{{{head},\"polarisation_mosaic\":{mosaic},\"frames\":[{}]}}", frame(0, ""));
        seeds.put("transforms", name, text);
    }
    let region = ",\"white_region\":[1,1,2,2]";
    seeds.put("transforms", "board", format!("{{{head},\"frames\":[{},{}]}}", frame(0, region), frame(1, region)));
    let bracket = posed(0, &format!("\"exposures\":[{}]", list("exposure_time", [0.5, 2.0, 0.125])));
    seeds.put("transforms", "bracket", format!("{{{head},\"frames\":[{bracket}]}}"));
    for (name, model, numbers) in [
        ("opencv", "OPENCV", "\"k1\":0.1,\"k2\":-0.02,\"p1\":0.001,\"p2\":0.002"),
        ("rational", "FULL_OPENCV", "\"k1\":0.1,\"k2\":0.1,\"k3\":0.01,\"k4\":0.2,\"k5\":0.1,\"k6\":0.05"),
        ("fisheye", "OPENCV_FISHEYE", "\"k1\":0.1,\"k2\":0.01,\"k3\":0.001,\"k4\":0.0001"),
        ("pinhole", "PINHOLE", "\"k1\":0"),
    ] {
        let turned = "\"mesh_transform\":[[0,1,0,0.1],[-1,0,0,0],[0,0,1,0],[0,0,0,1]]";
        let text = format!("{{{head},{turned},\"camera_model\":\"{model}\",{numbers},\"frames\":[{}]}}", frame(0, ""));
        seeds.put("transforms", name, text);
    }
}

/// The first byte is the program's number in the target.
fn imports(seeds: &Seeds) {
    let put = |name: &str, kind: u8, text: &str| {
        let text = text.replace("SIDE", &SIDE.to_string());
        seeds.put("imports", name, [&[kind], text.as_bytes()].concat());
    };
    let metashape = r#"<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="1" enabled="true"><sensors><sensor id="0"
type="KIND"><calibration type="KIND" class="adjusted"><resolution width="SIDE" height="SIDE"/><f>8</f><cx>0.1</cx><cy>-0.1</cy><b1>0.1</b1><b2>SKEW</b2>
<k1>0.1</k1><k2>0.01</k2><k3>0</k3><k4>0</k4><p1>SKEW</p1><p2>0</p2></calibration></sensor></sensors><components><component id="0"><transform>
<rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>1 2 3</translation><scale>2</scale></transform></component></components><cameras><group id="0">
<camera id="0" sensor_id="0" component_id="0" label="a"><transform>1 0 0 0 0 -1 0 0 0 0 -1 4 0 0 0 1</transform></camera></group>
<camera id="1" sensor_id="0" label="b.tif"><transform>1 0 0 0 0 -1 0 0 0 0 -1 4 0 0 0 1</transform></camera>
<camera id="2" sensor_id="0" label="c" enabled="0"/><camera id="3" sensor_id="0" label="d"/></cameras>
<reference>LOCAL_CS["Local"]</reference><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></chunk></document>"#;
    put("metashape", 0, &metashape.replace("KIND", "frame").replace("SKEW", "0.01"));
    put("metashape-fisheye", 0, &metashape.replace("KIND", "fisheye").replace("SKEW", "0"));
    put("metashape-earth", 0, &metashape.replace("KIND", "frame").replace("SKEW", "0").replace("LOCAL_CS", "GEOGCS"));
    let columns = "#cameras 2\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n";
    put(
        "table",
        1,
        &format!("{columns}a.tif,0,0,4,0,0,0,36,0.01,0,0.1,0,0,0,0.01,0\n\nb,1,0,4,10,5,-3,36,0,0,0,0,0,0,0,0\n"),
    );
    put("realityscan", 1, "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm\na.tif,0,0,4,0,0,0,36,0,0\n");
    for (number, model) in ["perspective", "brown3", "brown4t2", "division"].into_iter().enumerate() {
        let text = r#"<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description
xcr:Version="3" xcr:Coordinates="absolute" xcr:DistortionModel="MODEL" xcr:FocalLength35mm="36" xcr:Skew="0.01" xcr:AspectRatio="1.1" xcr:PrincipalPointU="0.01"
xcr:PrincipalPointV="0" xcr:Position="0 0 4" xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#"><xcr:Rotation>1 0 0 0 -1 0 0 0 -1</xcr:Rotation>
<xcr:DistortionCoeficients>0.1 0.01 0 0 0.001 0</xcr:DistortionCoeficients></rdf:Description></rdf:RDF></x:xmpmeta>"#;
        put(&format!("sidecar-{number}"), 2, &text.replace("MODEL", model));
    }
    let pose = r#""rotation":["1","0","0","0","-1","0","0","0","-1"],"center":["0","0","4"]"#;
    for (number, (version, intrinsic)) in [
        (r#""1","2","11""#, r#""type":"pinhole","distortionType":"brown","undistortionType":"none","focalLength":"36","sensorWidth":"36","pixelRatio":"1.1""#),
        (r#""1","2","3""#, r#""type":"fisheye4","focalLength":"36","sensorWidth":"36","pixelRatio":"1.1""#),
        (r#""1","2","0""#, r#""type":"radial3","pxFocalLength":["8","9"]"#),
        (r#""1","0","0""#, r#""type":"fisheye1","pxFocalLength":"8""#),
        (r#""1","2","8""#, r#""type":"pinhole","distortionType":"radialk3pt","focalLength":36"#),
    ]
    .into_iter()
    .enumerate()
    {
        put(
            &format!("meshroom-{number}"),
            3,
            &format!(
                r#"{{"version":[{version}],"featuresFolders":[],"views":[{{"viewId":"1","poseId":"1","intrinsicId":"5","path":"/x/a.tif"}},
{{"viewId":"2","poseId":"1","rigId":"3","subPoseId":"0","isPoseIndependant":"false","intrinsicId":"5","path":"D:\\x\\b.tif"}},{{"viewId":"3","path":"c"}}],
"intrinsics":[{{"intrinsicId":"5","width":"SIDE","height":"SIDE",{intrinsic},"principalPoint":["0.1","0"],"distortionParams":["0.1","0.01","0","0.001","0"]}}],
"poses":[{{"poseId":"1","pose":{{"transform":{{{pose}}},"locked":"0"}}}}],"rigs":[{{"rigId":"3","subPoses":[{{"pose":{{{pose}}}}}]}}]}}"#
            ),
        );
    }
    for (name, lens) in [
        ("pinhole", ""),
        ("pinhole_radial_k1", r#","disto_k1":[0.1]"#),
        ("pinhole_radial_k3", r#","disto_k3":[0.1,0.01,0]"#),
        ("pinhole_brown_t2", r#","disto_t2":[0.1,0.01,0,0.001,0]"#),
        ("fisheye", r#","fisheye":[0.1,0.01,0,0]"#),
    ] {
        put(
            name,
            4,
            &format!(
                r#"{{"sfm_data_version":"0.3","root_path":"/x","views":[{{"key":0,"value":{{"polymorphic_id":1073741824,"ptr_wrapper":{{"id":2147483649,
"data":{{"local_path":"","filename":"a.tif","width":SIDE,"height":SIDE,"id_view":0,"id_intrinsic":0,"id_pose":0}}}}}}}}],"intrinsics":[{{"key":0,
"value":{{"polymorphic_id":2147483649,"polymorphic_name":"{name}","ptr_wrapper":{{"id":2147483650,"data":{{"width":SIDE,"height":SIDE,"focal_length":8.0,
"principal_point":[4.0,4.0]{lens}}}}}}}}}],"extrinsics":[{{"key":0,"value":{{"rotation":[[1,0,0],[0,-1,0],[0,0,-1]],"center":[0,0,4]}}}}]}}"#
            ),
        );
    }
}

/// The first byte is 0 for text, 1 for binary; then the length of the cameras.
fn colmap(seeds: &Seeds) {
    let put = |name: &str, kind: u8, cameras: &[u8], images: &[u8]| {
        let length = (cameras.len() as u16).to_le_bytes();
        seeds.put("colmap", name, [&[kind], &length[..], cameras, images].concat());
    };
    let models: [(&str, u32, &[f64]); 6] = [
        ("SIMPLE_PINHOLE", 0, &[8.0, 4.0, 4.0]),
        ("PINHOLE", 1, &[8.0, 8.5, 4.0, 4.0]),
        ("SIMPLE_RADIAL", 2, &[8.0, 4.0, 4.0, 0.1]),
        ("RADIAL", 3, &[8.0, 4.0, 4.0, 0.1, 0.01]),
        ("OPENCV", 4, &[8.0, 8.5, 4.0, 4.0, 0.1, 0.01, 0.001, 0.002]),
        ("OPENCV_FISHEYE", 5, &[8.0, 8.5, 4.0, 4.0, 0.1, 0.01, 0.001, 0.002]),
    ];
    let mut images = 2u64.to_le_bytes().to_vec();
    for (number, name) in ["a.tif\0", "b.tif\0"].into_iter().enumerate() {
        images.extend((number as u32 + 1).to_le_bytes());
        [1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 4.0f64].iter().for_each(|x| images.extend(x.to_le_bytes()));
        images.extend(7u32.to_le_bytes().iter().chain(name.as_bytes()).chain(&(number as u64).to_le_bytes()));
        images.extend(vec![0; 24 * number]);
    }
    for (name, id, parameters) in models {
        let numbers: Vec<String> = parameters.iter().map(f64::to_string).collect();
        let cameras = format!("# cameras\n7 {name} {SIDE} {SIDE} {}\n", numbers.join(" "));
        let text = "# images\n1 1 0 0 0 0.1 0 4 7 a.tif\n1 2 3 4 5 6\n2 0.5 0.5 0.5 0.5 0 0 4 7 b.tif\n\n";
        put(&format!("{name}.txt"), 0, cameras.as_bytes(), text.as_bytes());
        let mut cameras = 1u64.to_le_bytes().to_vec();
        cameras.extend(7u32.to_le_bytes().iter().chain(&id.to_le_bytes()));
        cameras.extend([SIDE as u64; 2].iter().flat_map(|side| side.to_le_bytes()));
        parameters.iter().for_each(|x| cameras.extend(x.to_le_bytes()));
        put(&format!("{name}.bin"), 1, &cameras, &images);
    }
}

fn calibrations(seeds: &Seeds) {
    let opencv = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
        data: [ 500., 0., 319.5, 0., 5.1e+02, 239., 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   \
        dt: d\n   data: [ 0.1, -0.02, 0.001, 0.002, 0.03 ]\n";
    let ros = "image_width: 640\nimage_height: 480\ncamera_name: front\nK: [500, 0, 320, 0, 500, 240, 0, 0, 1]\n\
        distortion_model: equidistant\nD: [0.1, 0.2, 0.3, 0.4]\n";
    let rows =
        "width: &w 64\nheight: *w\ncamera_matrix:\n  - [50, 0, 32]\n  - [0, 50, 32]\n  - [0, 0, 1]\ndist_coeffs: []\n";
    let json =
        r#"{"w":640,"h":480,"fl_x":500,"fl_y":510,"cx":320,"cy":239.5,"camera_model":"OPENCV","k1":0.1,"p1":0.001}"#;
    let rig = r#"{"markers":[{"family":"tag36h11","id":3,"size":0.08},
 {"family":"aruco-original","id":7,"size":0.05,"pose":[[1,0,0,0.1],[0,0,-1,0],[0,1,0,0],[0,0,0,1]]}]}"#;
    let all = [
        ("opencv", opencv),
        ("ros", ros),
        ("rows", rows),
        ("json", json),
        ("rig", rig),
        ("marker", "tag36h11:76:0.065"),
    ];
    for (name, text) in all {
        seeds.put("calibration", name, text);
    }
    // ARToolKit's, of all versions; one whose distortion has another middle, and one with a thin prism.
    let matrix = [600.0, 0.0, 320.0, 0.0, 0.0, 610.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let versions: [&[f64]; 7] = [
        &[320.0, 240.0, 12.0, 0.98],
        &[320.0, 240.0, 0.98, 12.0, -3.0],
        &[320.0, 240.0, 0.98, 1.1, 12.0, -3.0],
        &[-0.2, 0.05, 0.002, -0.001, 600.0, 610.0, 320.0, 240.0, 1.05],
        &[-0.2, 0.05, 0.002, -0.001, 0.01, 0.02, 0.003, 0.001, 0.0, 0.0, 0.0, 0.0, 600.0, 610.0, 320.0, 240.0, 1.05],
        &[318.5, 263.5, 26.2, 1.0127],
        &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, -0.3, 0.0, 600.0, 600.0, 320.0, 240.0, 1.0],
    ];
    for (number, factors) in versions.iter().enumerate() {
        let numbers = matrix.iter().chain(*factors).flat_map(|x: &f64| x.to_be_bytes());
        let bytes: Vec<u8> = [640u32, 480].iter().flat_map(|side| side.to_be_bytes()).chain(numbers).collect();
        seeds.put("calibration", &format!("camera_para-{number}"), bytes);
    }
    let mut pattern = String::new();
    for turn in 0..4 {
        for k in 0..3 * 256 {
            let (mut row, mut column) = (k / 16 % 16, k % 16);
            (0..turn).for_each(|_| (row, column) = (column, 15 - row));
            pattern += if column == 3 || (row == 12 && column < 9) { "20 " } else { "230\n" };
        }
    }
    seeds.put("calibration", "pattern", pattern);
}
