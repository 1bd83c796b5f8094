// Planner that slows down for people, in TypeScript with rclnodejs on a ROS 2 host. Untested.
// npm install rclnodejs, with people_msgs sourced; any middleware of ROS 2.
import * as rclnodejs from 'rclnodejs';

async function main(): Promise<void> {
  await rclnodejs.init();
  const node = new rclnodejs.Node('planner');
  node.createSubscription('people_msgs/msg/People', '/people', (message: any) => {
    for (const { position, velocity, tags } of message.people) {
      const soonM = Math.hypot(position.x + velocity.x, position.y + velocity.y);
      console.log(`#${tags[0]} will be ${soonM.toFixed(2)} m away: ${soonM < 1.2 ? 'slow down' : 'go on'}`);
    }
  });
  node.spin();
}

main();
