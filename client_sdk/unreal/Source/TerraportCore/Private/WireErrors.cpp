#include "WireErrors.h"

#include "Messages.generated.h"

namespace terraport {

AfterClose afterClose(int closeCode) {
  switch (closeCode) {
    case kCloseNormal:
      return AfterClose::Done;
    case kCloseUnauthorised:
      return AfterClose::Token;
    case kCloseMalformed:
    case 4403:
    case 4404:
    case 4409:
    case 4413:
      return AfterClose::Stop;
    default:
      return AfterClose::Again;
  }
}

std::string codeOfClose(int closeCode) {
  for (const CloseCodeRow& row : kCloseCodes) {
    if (row.closeCode == closeCode) return row.error;
  }
  return "closed";
}

}  // namespace terraport
