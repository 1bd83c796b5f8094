// Planner that slows down for people, in C++ with zenoh-cpp and Fast CDR, without ROS. Untested.
// Key: <domain>/<topic>/<type>/<type hash>, as of rmw_zenoh. One argument: the router's endpoint.
#include <fastcdr/Cdr.h>
#include <cmath>
#include <iostream>
#include <thread>
#include <zenoh.hxx>

int main(int, char **argv) {
  auto config = zenoh::Config::create_default();
  config.insert_json5("mode", "\"client\"");
  config.insert_json5("connect/endpoints", "[\"" + std::string(argv[1]) + "\"]");
  auto session = zenoh::Session::open(std::move(config));
  auto subscriber = session.declare_subscriber(
      zenoh::KeyExpr("0/people/people_msgs::msg::dds_::People_/*"),
      [](const zenoh::Sample &sample) {
        auto bytes = sample.get_payload().as_vector();
        eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char *>(bytes.data()), bytes.size());
        eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::DEFAULT_ENDIAN,
                                   eprosima::fastcdr::CdrVersion::DDS_CDR);
        cdr.read_encapsulation();
        int32_t seconds;
        uint32_t nanoseconds, count;
        std::string frame, name;
        cdr >> seconds >> nanoseconds >> frame >> count;
        for (uint32_t i = 0; i < count; ++i) {
          double p[3], v[3], reliability;
          std::vector<std::string> tagnames, tags;
          cdr >> name >> p[0] >> p[1] >> p[2] >> v[0] >> v[1] >> v[2] >> reliability >> tagnames >> tags;
          const double soon_m = std::hypot(p[0] + v[0], p[1] + v[1]);
          std::cout << "#" << tags[0] << " will be " << soon_m << " m away" << std::endl;
        }
      },
      zenoh::closures::none);
  std::this_thread::sleep_for(std::chrono::hours(24));
}
