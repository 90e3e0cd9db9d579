// A driving system to copy, in C++ and without ROS: it connects to the exam, reads a line a tick, and answers it.
//
//   c++ -std=c++17 -O2 -o socket_ads examples/socket_ads.cpp
//   vpsci ads-socket --params params/ads_test.yaml -o out/socket --ads ./socket_ads
//
// It drives as vpsci_ros/nodes/example_driver.py does, to the bit. docs/ads.md (A socket) describes the lines. They are
// JSON, of which numbers_of() reads what this program needs; a program of your own takes a library.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

constexpr double kFront = 2.35, kSide = 0.93;  // [m] from the vehicle's centre to its bumper and to its side
constexpr double kRadius = 0.3;                // [m] of the pedestrian
constexpr double kCruise = 4.0;                // [m/s]
constexpr double kComfort = 2.0, kBraking = 3.0, kStrongest = 8.0;  // [m/s2]
constexpr double kHorizon = 2.5, kMargin = 0.7;                     // [s], [m] to keep free around the vehicle

struct Mover  // x, y [m], yaw [rad], speed [m/s], yaw rate [rad/s]; x east, y north, counter-clockwise from x
{
  double x, y, yaw, speed, yaw_rate;
};

// When they come within the margin [s], the vehicle at `speed` and its yaw rate, both going on so.
double time_to_contact(const Mover & car, const Mover & walker, double speed)
{
  double x = car.x, y = car.y, heading = car.yaw, px = walker.x, py = walker.y, time = 0.0;
  const double step = 0.1;
  while (time < kHorizon) {
    const double forward = std::cos(heading) * (px - x) + std::sin(heading) * (py - y);
    const double left = std::cos(heading) * (py - y) - std::sin(heading) * (px - x);
    if (std::abs(forward) < kFront + kRadius + kMargin && std::abs(left) < kSide + kRadius + kMargin) {
      return time;
    }
    time += step;
    heading += car.yaw_rate * step;
    x += speed * step * std::cos(heading);
    y += speed * step * std::sin(heading);
    px += walker.speed * step * std::cos(walker.yaw);
    py += walker.speed * step * std::sin(walker.yaw);
  }
  return std::numeric_limits<double>::infinity();
}

// What to do with the speed [m/s2]: brake for a contact within the horizon, else go on cruising.
double acceleration(const Mover & car, const std::vector<Mover> & walkers)
{
  double time = std::numeric_limits<double>::infinity();
  for (const Mover & walker : walkers) {
    time = std::min(time, time_to_contact(car, walker, std::max(car.speed, 1.0)));
  }
  if (time < kHorizon) {
    return -std::min(kStrongest, std::max(kBraking, 0.5 * car.speed / std::max(time, 0.1)));
  }
  return std::clamp((kCruise - car.speed) / 0.5, -kComfort, kComfort);
}

// All numbers of a key's value in a line, which is a number or (nested) arrays of numbers.
std::vector<double> numbers_of(const std::string & line, const std::string & key)
{
  std::vector<double> found;
  const std::size_t start = line.find('"' + key + "\":");
  if (start == std::string::npos) {
    return found;
  }
  int depth = 0;
  for (const char * at = line.c_str() + start + key.size() + 3; *at;) {
    char * end = nullptr;
    const double value = std::strtod(at, &end);
    if (end != at) {
      found.push_back(value);
      at = end;
    } else {
      depth += (*at == '[') - (*at == ']');
      ++at;
    }
    if (depth == 0) {
      break;
    }
  }
  return found;
}

std::vector<Mover> movers_of(const std::string & line, const std::string & key)
{
  std::vector<Mover> found;
  const std::vector<double> n = numbers_of(line, key);
  for (std::size_t i = 0; i + 5 <= n.size(); i += 5) {
    found.push_back({n[i], n[i + 1], n[i + 2], n[i + 3], n[i + 4]});
  }
  return found;
}

int main()
{
  const char * port = std::getenv("VPSCI_ADS_PORT");
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port ? std::atoi(port) : 0));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int connection = socket(AF_INET, SOCK_STREAM, 0);
  if (connect(connection, reinterpret_cast<const sockaddr *>(&address), sizeof address) != 0) {
    std::perror("no exam at the port in VPSCI_ADS_PORT");
    return 1;
  }
  std::string received;
  char piece[4096];
  for (ssize_t size; (size = read(connection, piece, sizeof piece)) > 0;) {
    received.append(piece, static_cast<std::size_t>(size));
    for (std::size_t end; (end = received.find('\n')) != std::string::npos; received.erase(0, end + 1)) {
      const std::string line = received.substr(0, end);
      if (line.find("\"type\":\"tick\"") == std::string::npos) {
        continue;  // hello; or reset: an episode begins, and this driver remembers nothing of the last one
      }
      char answer[128];
      const double command = acceleration(movers_of(line, "vehicle").at(0), movers_of(line, "pedestrians"));
      const int length = std::snprintf(
        answer, sizeof answer, "{\"tick\":%.0f,\"command\":%.17g}\n", numbers_of(line, "tick").at(0), command);
      if (write(connection, answer, static_cast<std::size_t>(length)) != length) {
        return 1;
      }
    }
  }
  return 0;  // the exam is over
}
