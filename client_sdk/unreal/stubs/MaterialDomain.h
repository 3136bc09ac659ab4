#pragma once

enum EMaterialDomain : int { MD_Surface };
