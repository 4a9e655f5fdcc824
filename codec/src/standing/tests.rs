//! Places in made-up fields: balls, rooms, skies, walls, and what nobody would expect.

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
    Surroundings::of(&field(rows), None, UP)
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
fn assert_is_unit_ball(content: Content, what: &str) {
    assert!(norm(content.center) < 0.15, "{what}: {content:?}");
    assert!((0.7..1.3).contains(&content.radius), "{what}: {content:?}");
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
    for (what, rows) in [
        ("alone", ball.clone()),
        ("in a room of 10", with(room(COUNT, 10.0))),
        ("in a room of 100", with(room(COUNT, 100.0))),
        ("in a room of 10 of many rows", with(room(3 * COUNT, 10.0))),
        ("under a sky at 30", with(sky(COUNT, 30.0))),
        ("under a sky at 1000", with(sky(COUNT, 1000.0))),
        ("with strays", with(strays(1e9))),
        ("on a floor", with(floor(30.0))),
        ("in a room with strays", [with(room(COUNT, 100.0)), strays(1e9)].concat()),
    ] {
        assert_is_unit_ball(surroundings(&rows).content, what);
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
        near(expected.content.center, found.content.center);
        let radius = found.content.radius / unit;
        assert!((radius / expected.content.radius - 1.0).abs() < 0.02, "{unit}: {radius}");
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
    let surroundings = surroundings(&[ball(COUNT, 1.0), room(COUNT, 10.0)].concat());
    let [a, b] = [0.0, 0.5].map(|turn| surroundings.stand_points(turn, (64, 48)));
    for a in a.content.iter().chain(&a.around) {
        assert!(b.content.iter().chain(&b.around).all(|b| distance(a.position(), b.position()) > 0.1));
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
        ("transparent", transparent),
        ("between the instants", brief),
        ("extreme", extreme),
    ] {
        for up in [UP, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3]] {
            let surroundings = Surroundings::of(&field, None, up);
            let Content { center, radius, bounds } = surroundings.content;
            let numbers = [center, bounds[0], bounds[1], [radius; 3]];
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
    let content = surroundings(&two).content;
    assert!(content.radius < 2.0 || (80.0..120.0).contains(&content.radius), "one of both: {content:?}");
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
    let surroundings = Surroundings::of(&moving, None, UP);
    let [low, high] = surroundings.content.bounds;
    assert!(low[0] < -2.5 && high[0] > 2.5 && low[1] > -1.3 && high[1] < 1.3, "{low:?} {high:?}");
    for camera in surroundings.stand_points(0.0, (64, 48)).content {
        assert!(looks_at(&camera, [-3.0, 0.0, 0.0]) && looks_at(&camera, [3.0, 0.0, 0.0]));
    }
}

#[test]
fn a_background_plate_is_in_the_way_and_never_content() {
    let (ball, room) = (field(&ball(300, 1.0)), field(&room(COUNT, 3.0)));
    let surroundings = Surroundings::of(&ball, Some(&room), UP);
    assert_is_unit_ball(surroundings.content, "in a plate");
    let StandPoints { content, around } = surroundings.stand_points(0.0, (64, 48));
    assert!(content.iter().all(|camera| norm(camera.position()) < 3.0));
    assert!(!around.is_empty());
}

#[test]
fn rows_that_nothing_shows_are_counted() {
    let below = |rows: Vec<Row>, y: f64| placed(&rows, 1.0, [0.0, -y, 0.0]);
    let closed = room(COUNT, 1.0).into_iter().map(|(center, _)| (center, 0.15)).collect();
    let field = field(&[closed, ball(100, 0.3), below(ball(50, 0.1), 500.0)].concat());
    let surroundings = Surroundings::of(&field, None, UP);
    let ring = &surroundings.stand_points(0.0, (64, 48)).content[..8];
    let of_sphere = unseen_rows(&field.select(&(0..COUNT).collect::<Vec<_>>()), None, ring);
    let unseen = unseen_rows(&field, None, ring);
    assert_eq!(unseen, of_sphere + 150, "those in the closed sphere and those far below");
    assert!(of_sphere < COUNT / 4, "its lower side: {of_sphere}");
    assert_eq!(unseen_rows(&field, None, &[]), COUNT + 150);
    assert!(unseen_rows(&Field::default(), None, ring) == 0);
}

#[test]
fn many_rows_are_looked_at_as_few() {
    let rows = |count| [ball(count, 1.0), room(count, 10.0)].concat();
    let [few, many] = [3000, 50_000].map(|count| surroundings(&rows(count)));
    assert_eq!(many.discs.rows, ROWS, "whatever the field, that many discs are looked at");
    assert!(distance(few.content.center, many.content.center) < 0.1);
    assert!((few.content.radius / many.content.radius - 1.0).abs() < 0.1);
    assert_eq!(many.stand_points(0.0, (64, 48)), surroundings(&rows(50_000)).stand_points(0.0, (64, 48)));
}
