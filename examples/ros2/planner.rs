// Planner that slows down for people, in Rust with zenoh and cdr, without ROS. Untested.
// Cargo.toml: zenoh = "1", cdr = "0.2", serde = { version = "1", features = ["derive"] }
use serde::Deserialize;
use zenoh::Wait;

#[derive(Deserialize)]
struct Point(f64, f64, f64);

#[derive(Deserialize)]
#[allow(dead_code)] // CDR has all fields, in this order
struct Person { name: String, position: Point, velocity: Point, reliability: f64, tagnames: Vec<String>, tags: Vec<String> }

#[derive(Deserialize)]
#[allow(dead_code)]
struct People { stamp: (i32, u32), frame_id: String, people: Vec<Person> }

fn main() {
    let mut config = zenoh::Config::default();
    let endpoint = std::env::args().nth(1).expect("the endpoint of the router");
    config.insert_json5("mode", "\"client\"").unwrap();
    config.insert_json5("connect/endpoints", &format!("[\"{endpoint}\"]")).unwrap();
    let session = zenoh::open(config).wait().unwrap();
    let key = "0/people/people_msgs::msg::dds_::People_/*"; // <domain>/<topic>/<type>/<hash>
    let subscriber = session.declare_subscriber(key).wait().unwrap();
    while let Ok(sample) = subscriber.recv() {
        let Ok(message) = cdr::deserialize::<People>(&sample.payload().to_bytes()) else { continue };
        for person in message.people {
            let soon_m = (person.position.0 + person.velocity.0).hypot(person.position.1 + person.velocity.1);
            println!("#{} will be {soon_m:.2} m away: {}", person.tags[0], if soon_m < 1.2 { "slow down" } else { "go on" });
        }
    }
}
