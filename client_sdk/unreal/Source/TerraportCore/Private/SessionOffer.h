// What is held, offered to a server in messages that it takes (wire protocol, section 5, rule 3). Pure.
#pragma once

#include "Messages.generated.h"

#include <cstdint>
#include <vector>

namespace terraport {

/// One offer: as much as `hello` takes, and the rest after the welcome.
class HeldOffer {
 public:
  /// What goes into `hello`. `rows`: everything that is held, most wanted first. `isInHello` false: nothing, because the
  /// server found it too large; all of it goes after the welcome, which says how large a message may be.
  std::vector<HeldRow> first(std::vector<HeldRow> rows, bool isInHello);

  /// The messages, once, that go after the welcome; `untold` gets the ids that no message can offer.
  std::vector<HeldMessage> rest(const WelcomeMessage& welcome, std::vector<std::uint32_t>& untold);

 private:
  std::vector<HeldRow> rest_;
};

}  // namespace terraport
