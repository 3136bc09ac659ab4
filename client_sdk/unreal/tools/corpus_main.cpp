// terraport-corpus wire|payload|session FOLDER

#include <cstdio>
#include <string>

#include "corpora.h"

int main(int count, char** arguments) {
  const std::string kind = count == 3 ? arguments[1] : "";
  if (kind == "wire") {
    return terraport::tools::runWireCorpus(arguments[2]);
  }
  if (kind == "payload") {
    return terraport::tools::runPayloadCorpus(arguments[2]);
  }
  if (kind == "session") {
    return terraport::tools::runSessionCorpus(arguments[2]);
  }
  std::fprintf(stderr, "usage: terraport-corpus wire|payload|session FOLDER\n");
  return 2;
}
