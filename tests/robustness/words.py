"""What may be put into damaged files, by format: words that mean something there."""

YAML_WORDS = (
    b"\n", b": ", b"- ", b"? ", b"&a ", b"*a", b"<<: ", b"!!binary ", b"!!python/tuple ", b"!!int ",
    b"---\n", b"...\n", b"| ", b"> ", b"{", b"}", b"[", b"]", b"# ", b"'", b'"', b"\t", b"null",
    b"2024-01-01", b"mode: raw\n", b"mode: scale\n", b"mode: trinary\n", b"negate: 1\n",
    b"occupied_thresh: 0.65\n", b"free_thresh: 0.196\n", b"cost_scale: costmap2d\n",
    b"image: m.pgm\n", b"more: {a: [1, 2]}\n", b"raw: true\n", b"%YAML 1.2\n---\n", b"~",
    b"- " * 30, b"[" * 30, b" # mapdeal: ignore image, map.\n", b"# mapdeal:ignore\n",
)  # fmt: skip
ROS1_WORDS = (
    *YAML_WORDS, b"$(arg x)", b"rad(pi)", b"deg(x)", b"!radians ", b"/a/b: 1\n", b"_ns: a\n",
    b"global_costmap: {}\n", b"local_costmap: {width: 1}\n", b"footprint: '[[1,1]'\n",
    b"robot_radius: .nan\n", b"robot_radius: -1e300\n", b"footprint_padding: -.inf\n",
    b"plugins: []\n", b"plugins: [a]\n", b"on: off\n", b"x:\n", b"inflation_radius: 1e-1\n",
)  # fmt: skip
ROS2_WORDS = (
    *YAML_WORDS, b"ros__parameters:\n", b"/**:\n", b"/*/", b"$(find-pkg-share x)", b"<ns>", b"\t",
    b": {}\n", b": []\n", b"!!float 1", b"!!binary aGk=", b"0x1p-3", b"robot_radius: 1\n",
    b"width: 0\n", b"plugins: [a]\n", b"footprint: '[[1,1]'\n", b"footprint_padding: .nan\n",
    b"robot_radius: 1e300\n", b"inflation_radius: -1.0\n", b"enabled: n\n",
)  # fmt: skip
TOML_WORDS = (
    b"[lint]\n", b"[tool.mapdeal.lint]\n", b"[[lint]]\n", b"lint.", b"= ", b"[" * 3000, b"{" * 50,
    b"]", b"}", b'"', b"'" * 3, b"\n", b"true", b"1_0", b"7" * 5000, b"0x", b"nan", b"1979-05-27",
    b"select = []\n", b'ignore = ["all"]\n', b"strict = 1\n", b'"error"', b"\\u0000", b"\xff", b"#",
)  # fmt: skip
JSON_WORDS = (
    b"null", b"true", b"NaN", b"-Infinity", b"[" * 40, b"{}", b"[]", b"[[]]", b'"', b"\\u0000",
    b"\\ud800", b'"value": 1, ', b'"type": "Point", ', b", ", b": ", b"1e400", b"7" * 400,
    b"7" * 5000,
)  # fmt: skip
NPY_WORDS = (
    b"'<f8'", b"'<i4'", b"'|O'", b"'<U3'", b"'|V4'", b"'>f4'", b"'<M8[s]'", b"'<c16'", b"'|b1'",
    b"True", b"(0, 3)", b"(4, 3, 1)", b"()", b"(-1,)", b"(1e3,)", b"(99999999999, 3)", b"lambda: 0",
    b"[('x', '<f4'), ('y', '<f8'), ('x', 'i1')]", b"[('x', '<f4', (2,)), ('y', '<f8')]", b"'a' * 9",
    b"(" * 200, b"-" * 200, b"\n@@occupancy.npy@@\n", b"\n@@cost.npy@@\n", b"\n@@a@@\n", b"L",
)  # fmt: skip
CLOUD_WORDS = (
    b"\n", b"# ", b"//", b"x", b"y", b"z", b"property float x\n", b"property list uchar int k\n",
    b"element vertex 2\n", b"element face 99999999999\n", b"end_header\n", b"comment \n", b"ascii",
    b"binary", b"binary_compressed", b"binary_big_endian", b"FIELDS x y\n", b"COUNT 0 1 1\n",
    b"HEIGHT 2\n", b"POINTS 0\n", b"DATA ascii\n", b"WIDTH 2\n", b"TYPE F F\n", b"nan", b"inf",
    b";",
)  # fmt: skip
SCAN_WORDS = (
    b"FLASER ", b"ROBOTLASER1 ", b"RAWLASER1 ", b"ODOM ", b"\nODOM nan 1 1\n", b"180", b"0 " * 40,
    b"\xef\xbb\xbf", b"\t", b"\r", b"\xa0", b"1 1 1 1 1 1 1 ",
)  # fmt: skip
IMAGE_WORDS = (
    b"IHDR", b"IDAT", b"IEND", b"tRNS", b"PLTE", b"acTL", b"\0\0\0\0tRNS\0\0\0\0", b"#" * 50,
    b"# \n" * 20, b"P5\n1 1\n255\n0", b"9" * 13, b"\xff\xd8", b"\xff\xc0", b"\xff\xda", b"\xff\xd9",
    b"\0\0\0\1", b"\1\0\0\0", b"\1\1\3\0\1\0\0\0\5\0\0\0", b"\3\1\3\0\1\0\0\0\7\0\0\0",
)  # fmt: skip
TEXT_WORDS = (
    b"[", b"]", b"]]", b"[[", b", ", b"[0, 0], ", b"[1, 1]" * 20, b"-", b"nan", b".inf", b"1_0",
    b"G", b"iB", b"kB", b"=", b".", b"none", b"\xc2\xa0", b"\xd9\xa1", b"(", b"9" * 30, b" " * 40,
)  # fmt: skip
BAG_WORDS = (
    b"\xff\xff\xff\x7f", b"\0\0\0\0", b"\1\0\0\0\0\0\0\0", b"\xff" * 8, b"op=\x02", b"op=\x05",
    b"conn=\0\0\0\0", b"\x05\x16\0\0\0\0\0\0\0", b"\x07", b"\x0f", b"\0\0\xc0\x7f", b"\0\0\x80\x7f",
    b"laser", b"base_link", b"map", b"float32", b"uint64", b"[]", b"string", b"cdr",
    b"zstd", b"bz2",
)  # fmt: skip
