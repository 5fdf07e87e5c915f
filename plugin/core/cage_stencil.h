// Values on a subdivision surface as weighted sums of those on its control cage.
#pragma once

#include <cstdint>
#include <vector>

namespace isolux {

// Rows of a sparse matrix: entries of row i are at [begin[i], begin[i + 1]), columns rising.
struct SparseRows {
    std::vector<std::int32_t> begin, columns;
    std::vector<double> weights;
};

// One value: its weights by the cage's values. Clear and AddWithWeight as OpenSubdiv wants them.
class CageStencil {
  public:
    CageStencil() = default;
    explicit CageStencil(std::int32_t column) : terms_{{column, 1.0}} {}

    bool empty() const { return terms_.empty(); }
    void Clear() { terms_.clear(); }
    void AddWithWeight(const CageStencil& other, double weight);
    // One term a column, in rising order.
    void gather();
    void append_to(SparseRows& rows) const;

  private:
    struct Term {
        std::int32_t column;
        double weight;
    };
    std::vector<Term> terms_;
};

// Each value of the cage by itself.
std::vector<CageStencil> unit_stencils(std::int32_t count);

SparseRows sparse_rows(const std::vector<CageStencil>& stencils);

} // namespace isolux
