// Planner that slows down for people, in C++ with rclcpp. Untested: no ROS host was at hand.
// Packages: rclcpp, people_msgs. It works with any middleware of ROS 2.
#include <cmath>
#include <people_msgs/msg/people.hpp>
#include <rclcpp/rclcpp.hpp>

int main(int argc, char **argv) {
  rclcpp::init(argc, argv);
  auto node = std::make_shared<rclcpp::Node>("planner");
  auto subscription = node->create_subscription<people_msgs::msg::People>(
      "/people", 10, [&](people_msgs::msg::People::ConstSharedPtr message) {
        for (const auto &person : message->people) {
          const double soon_m = std::hypot(person.position.x + person.velocity.x,
                                           person.position.y + person.velocity.y);
          RCLCPP_INFO(node->get_logger(), "#%s will be %.2f m away: %s", person.tags[0].c_str(),
                      soon_m, soon_m < 1.2 ? "slow down" : "go on");
        }
      });
  rclcpp::spin(node);
  rclcpp::shutdown();
}
