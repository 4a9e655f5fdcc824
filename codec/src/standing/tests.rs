//! Places in made-up fields: balls, rooms, skies, walls, and unlikely fields.

use super::discs::Disc;
use super::*;
use crate::Temporal;

/// Numbers from 0 to 1, the same ones each time.
fn numbers(mut state: u64) -> impl FnMut() -> f64 {
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A row: centre and standard deviation.
type Row = ([f64; 3], f64);

const UP: [f32; 3] = [0.0, 1.0, 0.0];

/// Rows of the ball and of what surrounds it.
const COUNT: usize = 3000;

fn direction(random: &mut impl FnMut() -> f64) -> [f64; 3] {
    let y = 2.0 * random() - 1.0;
    let (sin, cos) = libm::sincos(std::f64::consts::TAU * random());
    let level = (1.0 - y * y).sqrt();
    [level * cos, y, level * sin]
}

/// A solid ball around the origin.
fn ball(count: usize, radius: f64) -> Vec<Row> {
    let mut random = numbers(1);
    let row = |_| {
        let distance = radius * libm::cbrt(random());
        (direction(&mut random).map(|x| distance * x), 0.04 * radius)
    };
    (0..count).map(row).collect()
}

/// A closed sphere around the origin.
fn room(count: usize, radius: f64) -> Vec<Row> {
    let mut random = numbers(2);
    (0..count).map(|_| (direction(&mut random).map(|x| radius * x), 0.06 * radius)).collect()
}

/// The upper half of a sphere.
fn sky(count: usize, radius: f64) -> Vec<Row> {
    let raise = |(center, scale): Row| ([center[0], center[1].abs(), center[2]], scale);
    room(count, radius).into_iter().map(raise).collect()
}

fn field(rows: &[Row]) -> Field {
    Field {
        centers: rows.iter().map(|(center, _)| center.map(|x| x as f32)).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows.len()],
        log_scales: rows.iter().map(|(_, scale)| [libm::log(*scale) as f32; 3]).collect(),
        opacities: vec![0.9; rows.len()],
        sh: vec![[0.5; 3]; rows.len()],
        ..Field::default()
    }
}

fn surroundings(rows: &[Row]) -> Surroundings {
    Surroundings::new(&field(rows), None, UP)
}

/// The rows in another unit and around another origin, in that unit.
fn placed(rows: &[Row], unit: f64, origin: [f64; 3]) -> Vec<Row> {
    let place = |(center, scale): &Row| {
        (std::array::from_fn(|axis| unit * (center[axis] + origin[axis])), unit * scale)
    };
    rows.iter().map(place).collect()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    norm(sub(a, b))
}

/// Whether `content` is a ball of radius 1 around the origin.
fn assert_is_unit_ball(content: &Content, what: &str) {
    assert_eq!(content.balls.len(), 1, "{what}: {content:?}");
    assert!(norm(content.balls[0].center) < 0.15, "{what}: {content:?}");
    assert!((0.7..1.3).contains(&content.radius()), "{what}: {content:?}");
    for corner in content.bounds {
        assert!(corner.iter().all(|x| (0.6..1.3).contains(&x.abs())), "{what}: {content:?}");
    }
}

/// Whether a camera sees `point`, if nothing is before it.
fn looks_at(camera: &Camera, point: [f64; 3]) -> bool {
    let m = camera.camera_from_world;
    let [x, y, z] = [0, 1, 2].map(|r| dot([m[r][0], m[r][1], m[r][2]], point) + m[r][3]);
    z > 0.0
        && (x / z * camera.k[0][0]).abs() < camera.k[0][2]
        && (y / z * camera.k[1][1]).abs() < camera.k[1][2]
}

#[test]
fn the_content_is_what_is_dense_whatever_surrounds_it() {
    let ball = ball(COUNT, 1.0);
    let with = |more: Vec<Row>| [ball.clone(), more].concat();
    let strays =
        |at: f64| (0..COUNT / 50).map(|i| ([at, at * (i as f64).cos(), 0.0], 0.1)).collect::<Vec<Row>>();
    let floor = |size: f64| {
        let mut random = numbers(3);
        (0..COUNT).map(|_| ([size * (random() - 0.5), -1.0, size * (random() - 0.5)], 0.02 * size)).collect()
    };
    // A sixth of all rows, 100 to 600 radii behind it.
    let backdrop: Vec<Row> = {
        let mut random = numbers(5);
        let row = |_| {
            let z = -100.0 - 500.0 * random();
            ([z * (random() - 0.5), z * (random() - 0.5), z], 0.02 * z.abs())
        };
        (0..COUNT / 5).map(row).collect()
    };
    for rows in [ball.clone(), with(backdrop.clone())] {
        let opening = surroundings(&rows).opening();
        let [eye, target] = [opening.position, opening.target].map(|point| point.map(f64::from));
        assert!(norm(target) < 0.1 && (3.0..4.5).contains(&distance(eye, target)), "{opening:?}");
    }
    for (what, rows) in [
        ("alone", ball.clone()),
        ("in a room of 10", with(room(COUNT, 10.0))),
        ("in a room of 100", with(room(COUNT, 100.0))),
        ("in a room of 10 of many rows", with(room(3 * COUNT, 10.0))),
        ("under a sky at 30", with(sky(COUNT, 30.0))),
        ("under a sky at 1000", with(sky(COUNT, 1000.0))),
        ("with strays", with(strays(1e9))),
        ("on a floor", with(floor(30.0))),
        ("before a backdrop", with(backdrop.clone())),
        ("in a room with strays", [with(room(COUNT, 100.0)), strays(1e9)].concat()),
    ] {
        assert_is_unit_ball(&surroundings(&rows).content, what);
    }
}

#[test]
fn unit_and_origin_do_not_matter() {
    let rows = [ball(COUNT, 1.0), room(COUNT, 10.0)].concat();
    let expected = surroundings(&rows);
    for (unit, origin) in
        [(1e-3, [0.0; 3]), (1e6, [0.0; 3]), (1.0, [300.0, -2000.0, 50.0]), (1e-6, [40.0, 0.0, 1.0])]
    {
        let found = surroundings(&placed(&rows, unit, origin));
        let back = |point: [f64; 3]| std::array::from_fn(|axis| point[axis] / unit - origin[axis]);
        let near =
            |a: [f64; 3], b: [f64; 3]| assert!(distance(a, back(b)) < 0.02, "{unit}: {a:?} {:?}", back(b));
        near(expected.content.balls[0].center, found.content.balls[0].center);
        let radius = found.content_radius() / unit;
        assert!((radius / expected.content_radius() - 1.0).abs() < 0.02, "{unit}: {radius}");
        near(expected.opening().position.map(f64::from), found.opening().position.map(f64::from));
        let [a, b] = [&expected, &found].map(|surroundings| surroundings.stand_points(0.5, (64, 48)));
        assert_eq!(a.content.len(), b.content.len());
        for (a, b) in a.content.iter().zip(&b.content) {
            near(a.position(), b.position());
        }
    }
}

#[test]
fn an_object_alone_is_seen_from_all_around() {
    let surroundings = surroundings(&ball(COUNT, 1.0));
    let StandPoints { content, around } = surroundings.stand_points(0.0, (64, 48));
    assert_eq!((content.len(), around.len()), (8, 0));
    for camera in &content {
        assert!((2.5..4.5).contains(&norm(camera.position())), "{:?}", camera.position());
        assert!(looks_at(camera, [0.0; 3]) && camera.position()[1] > 0.0);
        assert_eq!((camera.width, camera.height), (64, 48));
    }
    let sums = (0..3).map(|axis| content[..5].iter().map(|camera| camera.position()[axis]).sum::<f64>());
    assert!(sums.zip([0.0, 3.0, 0.0]).all(|(sum, high)| (sum - high).abs() < 1.5), "on all sides");
}

#[test]
fn people_stand_in_the_room_and_see_its_walls() {
    for radius in [4.0, 10.0, 100.0] {
        let rows = [ball(COUNT, 1.0), room(COUNT, radius)].concat();
        let surroundings = surroundings(&rows);
        let StandPoints { content, around } = surroundings.stand_points(0.0, (64, 48));
        assert_eq!(content.len(), 8, "{radius}");
        assert!(!around.is_empty(), "{radius}");
        for camera in content.iter().chain(&around) {
            assert!(
                (1.0..0.99 * radius).contains(&norm(camera.position())),
                "{radius}: {:?}",
                camera.position()
            );
        }
        let opening = surroundings.opening();
        assert!((1.5..4.0).contains(&norm(opening.position.map(f64::from))), "{radius}: {opening:?}");
        let all = [content, around].concat();
        let walls = rows[COUNT..].iter();
        let seen = walls.filter(|(center, _)| all.iter().any(|camera| looks_at(camera, *center))).count();
        assert!(seen as f64 > 0.9 * COUNT as f64, "{radius}: {seen} of {COUNT}");
    }
}

#[test]
fn other_turns_are_other_places() {
    for rows in [[ball(COUNT, 1.0), room(COUNT, 10.0)].concat(), room(COUNT, 3.0)] {
        let surroundings = surroundings(&rows);
        let [a, b, c] = [0.0, 0.5, 0.75].map(|turn| surroundings.stand_points(turn, (64, 48)));
        for (a, b) in [(&a, &b), (&a, &c), (&b, &c)] {
            for a in a.content.iter().chain(&a.around) {
                let is_apart = |b: &Camera| distance(a.position(), b.position()) > 0.1;
                assert!(b.content.iter().chain(&b.around).all(is_apart));
            }
        }
    }
}

#[test]
fn nobody_stands_behind_a_wall() {
    // A wall through the front side, and a larger one right before the eye.
    let wall = |z: f64| {
        let mut random = numbers(4);
        (0..COUNT).map(|_| ([8.0 * (random() - 0.5), 8.0 * (random() - 0.5), z], 0.2)).collect::<Vec<Row>>()
    };
    let front = surroundings(&ball(COUNT, 1.0)).opening();
    let z = f64::from(front.position[2]);
    assert!(z > 2.0, "{front:?}");
    for share in [0.5, 0.95] {
        let surroundings = surroundings(&[ball(COUNT, 1.0), wall(share * z)].concat());
        let opening = surroundings.opening();
        let look = surroundings.look(opening.camera(UP, SIZE.0, SIZE.1), z);
        assert!(look.glance.content > 0.5 && look.is_free(), "{share}: {opening:?}");
        assert!((opening.position[2] as f64) < 0.9 * share * z, "{share}: {opening:?}");
        for camera in surroundings.stand_points(0.0, (64, 48)).content {
            let look = surroundings.look(camera.resized(SIZE.0, SIZE.1), z);
            assert!(look.shows_content(), "{share}: {:?}", camera.position());
        }
    }
}

#[test]
fn a_room_is_seen_from_its_middle() {
    let surroundings = surroundings(&room(COUNT, 3.0));
    let StandPoints { content, .. } = surroundings.stand_points(0.0, (64, 48));
    assert_eq!(content.len(), 12);
    assert!(content[8..].iter().all(|camera| norm(camera.position()) < 0.5));
}

#[test]
fn odd_fields_get_places_and_an_opening() {
    let one: Vec<Row> = vec![([1.0, 2.0, 3.0], 0.1)];
    let small = ([0.0; 3], 0.01);
    let tunnel = (0..COUNT).map(|i| {
        let (sin, cos) = libm::sincos(2.4 * i as f64);
        ([2.0 * cos, 2.0 * sin, 40.0 * i as f64 / COUNT as f64], 0.15)
    });
    // Houses of 8 x 20 x 8 every 20 units.
    let mut random = numbers(5);
    let city = (0..COUNT).map(|i| {
        let [x, y, z] = [8.0, 20.0, 8.0].map(|side| side * random());
        let [east, north] = [i % 5, i / 5 % 5].map(|house| 20.0 * house as f64);
        ([east + if x < 4.0 { 0.0 } else { 8.0 }, y, north + z], 0.5)
    });
    let two = [ball(COUNT, 1.0), placed(&ball(COUNT, 100.0), 1.0, [300.0, 0.0, 0.0])].concat();
    let mut transparent = field(&ball(100, 1.0));
    transparent.opacities.fill(0.0);
    let mut brief = field(&ball(100, 1.0));
    brief.temporal = Some(Temporal { tau: vec![0.0; 100], s: vec![1e-4; 100], ..Temporal::default() });
    let mut extreme = field(&[one.clone(), vec![small; 9]].concat());
    extreme.log_scales = vec![[88.0, -3e38, 3e38]; 10];
    extreme.centers[3] = [3e38, -3e38, 0.0];
    for (what, field) in [
        ("none", Field::default()),
        ("one row", field(&one)),
        ("one point", field(&vec![one[0]; 50])),
        ("two points", field(&[small, one[0]])),
        ("a millionth", field(&placed(&ball(50, 1.0), 1e-6, [0.0; 3]))),
        ("only a sky", field(&sky(COUNT, 1000.0))),
        ("two subjects", field(&two)),
        ("a tunnel", field(&tunnel.collect::<Vec<Row>>())),
        ("a city block", field(&city.collect::<Vec<Row>>())),
        ("transparent", transparent),
        ("between the instants", brief),
        ("extreme", extreme),
    ] {
        for up in [UP, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3]] {
            let surroundings = Surroundings::new(&field, None, up);
            let (radius, bounds) = (surroundings.content_radius(), surroundings.content_bounds());
            let numbers = [bounds[0], bounds[1], [radius; 3]];
            assert!(
                numbers.as_flattened().iter().all(|x| x.is_finite()) && radius > 0.0,
                "{what}: {numbers:?}"
            );
            let opening = surroundings.opening();
            assert_eq!(opening.camera(up, 64, 48).check(), Ok(()), "{what}");
            assert_ne!(opening.position, opening.target, "{what}");
            let points = surroundings.stand_points(0.5, (64, 48));
            assert!(!points.content.is_empty(), "{what}");
            points
                .content
                .iter()
                .chain(&points.around)
                .for_each(|camera| assert_eq!(camera.check(), Ok(()), "{what}"));
        }
    }
    let radius = surroundings(&two).content_radius();
    assert!(radius < 2.0 || (80.0..120.0).contains(&radius), "one of both: {radius}");
}

#[test]
fn thin_limbs_belong_to_a_body() {
    let arm = |side: f64| (0..COUNT / 20).map(move |i| ([side * (1.0 + 0.013 * i as f64), 0.0, 0.0], 0.004));
    let rows = [ball(COUNT, 1.0), arm(1.0).collect(), arm(-1.0).collect()].concat();
    let surroundings = surroundings(&rows);
    let [low, high] = surroundings.content_bounds();
    assert!(low[0] < -2.0 && high[0] > 2.0, "{low:?} {high:?}");
    let opening = surroundings.opening().camera(UP, 64, 48);
    assert!(looks_at(&opening, [-2.5, 0.0, 0.0]) && looks_at(&opening, [2.5, 0.0, 0.0]));
}

#[test]
fn two_people_are_the_content_together() {
    for (apart, are_both) in [(2.5, true), (5.0, true), (40.0, false)] {
        let people = [0.0, apart].map(|x| placed(&ball(COUNT, 1.0), 1.0, [x, 0.0, 0.0])).concat();
        for rows in [people.clone(), [people, room(COUNT, 60.0)].concat()] {
            let surroundings = surroundings(&rows);
            let [low, high] = surroundings.content_bounds();
            assert_eq!(high[0] - low[0] > apart, are_both, "{apart}: {low:?} {high:?}");
            let opening = surroundings.opening().camera(UP, 64, 48);
            assert!(!are_both || looks_at(&opening, [0.0; 3]) && looks_at(&opening, [apart, 0.0, 0.0]));
        }
    }
}

#[test]
fn a_moving_field_is_seen_at_all_times() {
    // A ball that crosses 8 units along x.
    let mut moving = field(&ball(COUNT, 1.0));
    let (tau, s) = (vec![0.5; COUNT], vec![f32::INFINITY; COUNT]);
    moving.temporal = Some(Temporal {
        tau,
        s,
        motion_order: 1,
        motion: vec![[8.0, 0.0, 0.0]; COUNT],
        rotation_rates: None,
    });
    let surroundings = Surroundings::new(&moving, None, UP);
    let [low, high] = surroundings.content.bounds;
    assert!(low[0] < -2.5 && high[0] > 2.5 && low[1] > -1.3 && high[1] < 1.3, "{low:?} {high:?}");
    for camera in surroundings.stand_points(0.0, (64, 48)).content {
        assert!(looks_at(&camera, [-3.0, 0.0, 0.0]) && looks_at(&camera, [3.0, 0.0, 0.0]));
    }
    // One who leaves halfway through: the content is where they were.
    let mut leaves = moving;
    leaves.temporal.as_mut().unwrap().s.fill(0.1);
    leaves.temporal.as_mut().unwrap().tau.fill(0.2);
    let [low, high] = Surroundings::new(&leaves, None, UP).content_bounds();
    assert!(low[0] > -2.0 && high[0] < 2.5, "{low:?} {high:?}");
}

#[test]
fn a_background_plate_is_in_the_way_and_never_content() {
    let ball = field(&ball(300, 1.0));
    for radius in [3.0, 10.0] {
        let surroundings = Surroundings::new(&ball, Some(&field(&room(COUNT, radius))), UP);
        assert_is_unit_ball(&surroundings.content, "in a plate");
        let StandPoints { content, around } = surroundings.stand_points(0.0, (64, 48));
        assert!(content.iter().all(|camera| norm(camera.position()) < radius));
        assert!(!around.is_empty(), "{radius}");
    }
    let room = field(&room(COUNT, 3.0));
    // Gaussians that fade before the eye hide nothing, and yet no stand point is among them.
    let faded = Surroundings::new(&Field { near: 1.2, ..ball }, Some(&Field { near: 1.2, ..room }), UP);
    let content = faded.stand_points(0.0, (64, 48)).content;
    assert!(content.iter().all(|camera| norm(camera.position()) > 1.0), "nobody stands in the ball");
}

#[test]
fn rows_that_nothing_shows_are_counted() {
    let below = |rows: Vec<Row>, y: f64| placed(&rows, 1.0, [0.0, -y, 0.0]);
    let closed = room(COUNT, 1.0).into_iter().map(|(center, _)| (center, 0.15)).collect();
    let field = field(&[closed, ball(100, 0.3), below(ball(50, 0.1), 500.0)].concat());
    let surroundings = Surroundings::new(&field, None, UP);
    let ring = &surroundings.stand_points(0.0, (64, 48)).content[..8];
    let sphere = field.select(&(0..COUNT).collect::<Vec<_>>());
    let hidden = |field: &Field, plate: Option<&Field>, cameras: &[Camera]| -> Vec<usize> {
        let sights = CoarseField::sights(field, plate, 0.0, cameras);
        (0..sights.len()).filter(|row| sights[*row] == Sight::Hidden).collect()
    };
    let of_sphere = hidden(&sphere, None, ring);
    assert!(of_sphere.len() < COUNT / 4, "its lower side: {}", of_sphere.len());
    let within_and_below: Vec<usize> = (COUNT..COUNT + 150).collect();
    let expected = [&of_sphere[..], &within_and_below].concat();
    assert_eq!(hidden(&field, None, ring), expected);
    assert_eq!(hidden(&sphere, Some(&field.select(&within_and_below)), ring), expected, "of a plate");
    assert_eq!(hidden(&field, None, &[]).len(), field.len());
    let mut later = sphere.clone();
    let count = later.len();
    later.temporal = Some(Temporal { tau: vec![0.9; count], s: vec![0.01; count], ..Temporal::default() });
    assert_eq!(CoarseField::sights(&later, None, 0.1, ring), vec![Sight::Absent; count]);
}

#[test]
fn a_view_is_informative_with_pixels_and_rows_of_which_none_is_alone() {
    let is_informative = |rows: &[Row], target: [f64; 3]| {
        let camera = Camera::look_at([0.0, 0.0, 8.0], target, UP.map(f64::from), 0.8, 320, 240);
        CoarseField::new(&field(rows), None, 0.0).is_informative(&camera)
    };
    let sphere = ball(400, 2.0);
    assert!(is_informative(&sphere, [0.0; 3]));
    assert!(!is_informative(&sphere, [0.0, 0.0, 20.0]), "it looks away");
    assert!(!is_informative(&placed(&sphere, 1.0, [0.0, 0.0, -400.0]), [0.0; 3]), "too far away");
    let before_the_lens = [&sphere[..], &[([0.0, 0.0, 7.0], 0.5)]].concat();
    assert!(!is_informative(&before_the_lens, [0.0; 3]), "the inside of one Gaussian");
    assert!(!is_informative(&[&sphere[..30], &placed(&sphere, 1.0, [0.0, 0.0, 90.0])].concat(), [0.0; 3]));
    let few: Vec<Row> = ball(3, 1.0).into_iter().map(|(center, _)| (center, 0.3)).collect();
    assert!(is_informative(&few, [0.0; 3]), "a field of few Gaussians, all of them");
    assert!(!is_informative(&[], [0.0; 3]), "nothing is alive");
}

#[test]
fn one_disc_stands_for_several_that_are_wide_and_translucent() {
    let haze: Vec<Row> = ball(ROWS - COUNT, 1.0).into_iter().map(|(center, _)| (center, 0.5)).collect();
    let mut field = field(&[ball(COUNT, 0.3), haze].concat());
    field.opacities[COUNT..].fill(0.02);
    let hazy = Surroundings::new(&field, None, UP);
    let (narrow, wide): (Vec<&Disc>, Vec<&Disc>) =
        hazy.discs.instants[0].iter().partition(|disc| disc.row < COUNT);
    assert_eq!(narrow.len(), COUNT);
    assert!(wide.len() < (ROWS - COUNT) / 8, "{}", wide.len());
    let opacity: f64 = wide.iter().map(|disc| disc.opacity).sum();
    assert!((opacity / (0.02 * (ROWS - COUNT) as f64) - 1.0).abs() < 0.01, "{opacity}");
    field.opacities[COUNT..].fill(0.9);
    assert_eq!(Surroundings::new(&field, None, UP).discs.instants[0].len(), ROWS, "opaque ones stay");
}

#[test]
fn many_rows_are_looked_at_as_few() {
    let rows = |count| [ball(count, 1.0), room(count, 10.0)].concat();
    let [few, many] = [3000, 50_000].map(|count| surroundings(&rows(count)));
    assert_eq!(many.discs.rows, ROWS, "whatever the field, that many discs are looked at");
    assert!(distance(few.content.balls[0].center, many.content.balls[0].center) < 0.1);
    assert!((few.content_radius() / many.content_radius() - 1.0).abs() < 0.1);
    assert_eq!(many.stand_points(0.0, (64, 48)), surroundings(&rows(50_000)).stand_points(0.0, (64, 48)));
}

#[test]
fn cameras_show_the_content_unless_they_are_in_something_or_look_away() {
    let mut rows = ball(COUNT, 1.0);
    rows.push(([0.0, 0.0, -3.9], 0.4));
    let at = |position: [f64; 3], target: [f64; 3]| {
        Camera::look_at(position, target, UP.map(f64::from), 0.8, 320, 240)
    };
    let cameras = [
        at([0.0, 0.0, 4.0], [0.0; 3]),
        at([0.0, 0.0, -4.0], [0.0; 3]),
        at([4.0, 0.0, 0.0], [9.0, 0.0, 0.0]),
        at([-4.5, 1.0, 0.0], [0.0; 3]),
    ];
    let surroundings = surroundings(&rows);
    assert_eq!(surroundings.which_show_content(cameras.iter()), [true, false, false, true]);
    assert_eq!(surroundings.which_show_content(cameras[1..3].iter()), [false; 2]);
    // Something covers the rim of the first camera's picture.
    rows.push(([0.3, 0.0, 3.6], 0.1));
    let surroundings = self::surroundings(&rows);
    assert_eq!(surroundings.which_show_content(cameras.iter()), [false, false, false, true]);
    assert_eq!(
        surroundings.which_show_content(cameras[..3].iter()),
        [true, false, false],
        "if there is no other"
    );
}

#[test]
fn the_view_of_a_camera_looks_at_the_content_or_at_what_it_sees() {
    for (unit, origin) in [(1.0, [0.0; 3]), (1e-3, [0.0, 0.0, -3.0]), (1e5, [40.0, 0.0, 7.0])] {
        let room = placed(&[ball(COUNT, 1.0), room(COUNT, 30.0)].concat(), unit, origin);
        let at =
            |point: [f64; 3]| -> [f64; 3] { std::array::from_fn(|axis| unit * (point[axis] + origin[axis])) };
        let surroundings = surroundings(&room);
        let camera = |target| Camera::look_at(at([0.0, 0.0, 4.0]), at(target), [0.0, 1.0, 0.0], 0.7, 64, 48);
        let target = |camera: &Camera| surroundings.viewpoint("at camera", camera).target.map(f64::from);
        let ahead = surroundings.viewpoint("ahead", &camera([0.0; 3]));
        assert!(distance(ahead.target.map(f64::from), at([0.0; 3])) < 0.2 * unit, "{ahead:?}");
        assert!((ahead.fov_y - 0.7).abs() < 1e-6 && ahead.name == "ahead");
        let wall = target(&camera([0.0, 0.0, 8.0]));
        assert!(distance(wall, at([0.0, 0.0, 29.0])) < 3.0 * unit, "{wall:?}");
    }
}

/// A person of 1.8 units who stands on the ground at (`x`, 0, 0).
fn person(x: f64) -> Vec<Row> {
    let mut random = numbers(5);
    let row = |_| {
        let [side, _, front] = direction(&mut random);
        ([x + 0.25 * side, 1.8 * random(), 0.15 * front], 0.03)
    };
    (0..COUNT).map(row).collect()
}

/// The floor and two walls of a room of 8 units, on the ground around the origin.
fn corner() -> Vec<Row> {
    let mut random = numbers(6);
    let row = |i: usize| {
        let [a, b] = [8.0 * (random() - 0.5), random() - 0.5];
        ([[a, 0.0, 8.0 * b], [a, 1.5 + 3.0 * b, -4.0], [4.0, 1.5 + 3.0 * b, a]][i % 3], 0.2)
    };
    (0..COUNT / 2).map(row).collect()
}

/// A body of 1.8 units on the ground at the origin: most of its weight is in the trunk, arms and legs are thin.
fn slender() -> Vec<Row> {
    let mut random = numbers(7);
    let mut part = |count: usize, center: [f64; 3], size: [f64; 3], scale: f64| {
        (0..count)
            .map(|_| {
                let side = direction(&mut random);
                (std::array::from_fn(|axis| center[axis] + size[axis] * side[axis]), scale)
            })
            .collect::<Vec<Row>>()
    };
    [
        part(1500, [0.0, 1.2, 0.0], [0.2, 0.35, 0.13], 0.02),
        part(400, [0.0, 1.65, 0.0], [0.1, 0.15, 0.1], 0.015),
        part(200, [0.5, 1.4, 0.0], [0.3, 0.05, 0.05], 0.012),
        part(200, [-0.5, 1.4, 0.0], [0.3, 0.05, 0.05], 0.012),
        part(200, [0.12, 0.45, 0.0], [0.06, 0.45, 0.06], 0.015),
        part(200, [-0.12, 0.45, 0.0], [0.06, 0.45, 0.06], 0.015),
    ]
    .concat()
}

#[test]
fn a_body_stands_on_its_feet_in_a_room() {
    let walls: Vec<Row> = corner().into_iter().filter(|(center, _)| center[1] > 0.05).collect();
    for (what, around) in [("on a floor", corner()), ("without a floor", walls)] {
        let rows = [slender(), around].concat();
        let [low, high] = surroundings(&rows).content_bounds();
        assert!(low[1].abs() < 0.05 && (high[1] - 1.8).abs() < 0.1, "{what}: {low:?} {high:?}");
        // The part of the floor below the body counts.
        assert!(low[0] > -1.2 && high[0] < 1.2 && high[2] < 0.5, "{what}: {low:?} {high:?}");
        // The same body on its side.
        let rolled: Vec<Row> = rows.iter().map(|([x, y, z], scale)| ([-y, *x, *z], *scale)).collect();
        let [low, high] = Surroundings::new(&field(&rolled), None, [-1.0, 0.0, 0.0]).content_bounds();
        assert!((low[0] + 1.8).abs() < 0.1 && high[0].abs() < 0.05, "{what}: {low:?} {high:?}");
    }
    // What is on a table does not reach through the air below it.
    let table = |y: f64| {
        (0..1000).map(move |i| ([0.1 * f64::from(i % 32) - 1.6, y, 0.1 * f64::from(i / 32) - 1.6], 0.05))
    };
    let rows = [ball(COUNT, 0.3), table(-0.3).collect(), placed(&corner(), 1.0, [0.0, -1.2, 0.0])].concat();
    let [low, _] = surroundings(&rows).content_bounds();
    assert!((low[1] + 0.3).abs() < 0.05, "{low:?}");
}

#[test]
fn nobody_opens_in_the_haze_of_a_wall() {
    let ball = field(&ball(COUNT, 1.0));
    let z = f64::from(Surroundings::new(&ball, None, UP).opening().position[2]);
    let mut haze = field(&room(COUNT, 0.95 * z));
    haze.opacities.fill(0.02);
    let surroundings = Surroundings::new(&ball, Some(&haze), UP);
    let opening = surroundings.opening();
    let blocked = surroundings.look(opening.camera(UP, SIZE.0, SIZE.1), z).glance.blocked;
    assert!(blocked <= 0.03 && opening.position[2] > 1.5, "{blocked}: {opening:?}");
}

/// A rectangle around the origin, `sides` along the axes, one of them 0.
fn flat(sides: [f64; 3]) -> Vec<Row> {
    let mut random = numbers(8);
    (0..COUNT).map(|_| (sides.map(|side| side * (random() - 0.5)), 0.02)).collect()
}

#[test]
fn flat_content_is_seen_from_its_broad_side() {
    for (sides, broad) in [([2.0, 1.5, 0.0], 2), ([0.0, 1.5, 2.0], 0), ([2.0, 0.0, 2.0], 1)] {
        let position = surroundings(&flat(sides)).opening().position.map(|x| f64::from(x).abs());
        let share = position[broad] / norm(position);
        // From above, people see it at an angle.
        let least = if broad == 1 { 0.45 } else { 0.99 };
        assert!(share > least, "{sides:?}: {position:?}");
    }
}

/// The four walls, the floor and the ceiling of a room of 6 x 2.5 x 6 units around the origin.
fn walls() -> Vec<Row> {
    let mut random = numbers(9);
    let row = |i: usize| {
        let [a, b] = [random() - 0.5, random() - 0.5];
        let side = if i.is_multiple_of(2) { 3.0 } else { -3.0 };
        let center = match i / 2 % 4 {
            0 => [side, 2.5 * a, 6.0 * b],
            1 => [6.0 * a, 2.5 * b, side],
            _ => [6.0 * a, 1.25 * side / 3.0, 6.0 * b],
        };
        (center, 0.1)
    };
    (0..COUNT).map(row).collect()
}

#[test]
fn a_furnished_room_is_seen_from_within() {
    let cupboards = |x: f64| placed(&ball(COUNT / 6, 0.7), 1.0, [x, -0.5, x]);
    let furnished = [walls(), cupboards(1.0), cupboards(-1.4)].concat();
    for (unit, origin) in [(1.0, [0.0; 3]), (1e-3, [500.0, 2.0, -70.0])] {
        let opening = surroundings(&placed(&furnished, unit, origin)).opening();
        for point in [opening.position, opening.target] {
            let point: [f64; 3] = std::array::from_fn(|axis| f64::from(point[axis]) / unit - origin[axis]);
            assert!(
                point[0].abs() < 2.9 && point[1].abs() < 1.2 && point[2].abs() < 2.9,
                "{unit}: {opening:?}"
            );
        }
    }
    // Somebody stands in the middle; and not even there, packages are judged from outside.
    let person = placed(&slender(), 1.0, [0.0, -1.25, 0.0]).into_iter().step_by(5).collect();
    let rows = [walls(), person].concat();
    let surroundings = surroundings(&rows);
    let is_within = |[x, y, z]: [f64; 3]| x.abs() < 2.9 && y.abs() < 1.2 && z.abs() < 2.9;
    let points = surroundings.stand_points(0.0, (64, 48));
    assert!(points.content.len() >= 8, "{}", points.content.len());
    assert!(points.content.iter().chain(&points.around).all(|camera| is_within(camera.position())));
    let opening = surroundings.opening();
    assert!(is_within(opening.position.map(f64::from)), "{opening:?}");
    assert!(looks_at(&opening.camera(UP, 64, 48), [0.0, 0.0, 0.0]), "{opening:?}");
    // A hollow body looks like a room without anything in it.
    for rows in [walls(), room(COUNT, 1.0)] {
        let opening = self::surroundings(&rows).opening();
        assert!(norm(opening.position.map(f64::from)) > 2.0, "{opening:?}");
    }
}

#[test]
fn the_box_along_other_axes_is_that_of_the_content() {
    let rows = [person(1.0), corner()].concat();
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let upright = surroundings(&rows);
    assert_eq!(upright.content_bounds_along(axes), upright.content_bounds());
    // The same room on its side, as in a clip whose axes are tilted.
    let tilted = |vector: [f64; 3]| rotate(vector, [0.6, 0.0, 0.8], 0.7);
    let aside: Vec<Row> = rows.iter().map(|(center, scale)| (tilted(*center), *scale)).collect();
    let found = Surroundings::new(&field(&aside), None, tilted([0.0, 1.0, 0.0]).map(|x| x as f32));
    let bounds = found.content_bounds_along(axes.map(tilted));
    let expected = [[0.75, 0.0, -0.15], [1.25, 1.8, 0.15]];
    for (corner, expected) in bounds.into_iter().zip(expected) {
        assert!(distance(corner, expected) < 0.1, "{bounds:?}");
    }
    assert!(distance(found.content_bounds()[0], bounds[0]) > 0.3, "those are along the axes of the clip");
}

#[test]
fn a_box_alone_is_its_own_content() {
    let bounds = [[1.0, 2.0, 3.0], [3.0, 8.0, 6.0]];
    let surroundings = Surroundings::from_box(bounds, UP);
    assert_eq!(surroundings.opening(), Viewpoint::framing(bounds, UP));
    let along = surroundings.content_bounds_along([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]);
    assert_eq!(along, [[3.0, 2.0, -3.0], [6.0, 8.0, -1.0]]);
    let point = Surroundings::from_box([[4.0; 3]; 2], UP);
    assert!(point.content_radius() > 0.0 && point.opening().position != point.opening().target);
}

/// A person who walks from x = -2 to x = 2 in clip time, in a room that stands still.
fn walk() -> Clip {
    let mut walker = field(&person(0.0));
    walker.temporal = Some(Temporal {
        tau: vec![0.5; COUNT],
        s: vec![f32::INFINITY; COUNT],
        motion_order: 1,
        motion: vec![[4.0, 0.0, 0.0]; COUNT],
        rotation_rates: None,
    });
    let room = field(&corner());
    Clip::of_one_layer(crate::ClipInfo { up: UP, ..Default::default() }, room.bounds(), room, walker, None)
}

#[test]
fn a_clip_is_looked_at_in_a_range_of_its_time() {
    let clip = walk();
    for (range, [from, to]) in
        [([0.0, 0.1], [-2.0, -1.6]), ([0.9, 1.0], [1.6, 2.0]), ([0.45, 0.55], [-0.2, 0.2])]
    {
        let [low, high] = Surroundings::from_clips(&[(&clip, range)], UP).content_bounds();
        assert!((low[0] - from).abs() < 0.35 && (high[0] - to).abs() < 0.35, "{range:?}: {low:?} {high:?}");
        assert!(low[1].abs() < 0.1 && (high[1] - 1.8).abs() < 0.1, "{range:?}: {low:?} {high:?}");
    }
    let [all, merged] = [clip.surroundings(), Surroundings::new(&clip.merged(), None, UP)];
    assert_eq!(all.content, merged.content, "both regions are one field");
    // Clips that are shown at once, each in its own time.
    let still = Clip { dynamic_field: Field::default(), ..clip.clone() };
    let walker = Clip { static_field: Field::default(), ..clip };
    let parts = Surroundings::from_clips(&[(&still, [0.0, 0.5]), (&walker, [0.9, 1.0])], UP);
    let [low, high] = parts.content_bounds();
    assert!((low[0] - 1.6).abs() < 0.35 && (high[0] - 2.0).abs() < 0.35, "{low:?} {high:?}");
}

#[test]
fn of_many_rows_each_part_is_looked_at_by_its_share() {
    let part = |count: usize, at: f64| field(&placed(&ball(count, 1.0), 1.0, [at, 0.0, 0.0]));
    let (large, small) = (part(3 * ROWS, 0.0), part(ROWS, 9.0));
    let mut builder = DiscsBuilder::new(large.len() + small.len(), ROWS);
    [&large, &small].into_iter().for_each(|field| builder.add(field, [0.0, 1.0]));
    let discs = builder.build();
    assert_eq!(discs.rows, ROWS);
    let of_small = discs.instants.iter().flatten().filter(|disc| disc.center[0] > 5.0);
    assert_eq!(of_small.count(), ROWS / 4);
    assert!(discs.instants.iter().flatten().enumerate().all(|(i, disc)| disc.row == i));
}
